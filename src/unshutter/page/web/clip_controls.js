// The panel beside a clip: what its moments say, what the user can say, saving.

/** @import { Clip } from "./clip.js" @import { On } from "./panel.js" @import { Options } from "./types.js" */

import { showEncoders } from "./encoding.js";
import { make } from "./nodes.js";
import { Panel } from "./panel.js";
import { keys, number, quiet, section, select } from "./widgets.js";
import { words } from "./words.js";

/** How a readout time is said -> the option. @type {Record<string, string>} */
const UNITS = { ms: "readout-ms", ratio: "readout-ratio", camera: "camera" };
/** @type {Record<string, { min: string, max: string, step: string }>} */
const LIMITS = { ms: { min: "0.1", max: "", step: "any" }, ratio: { min: "0.01", max: "1", step: "any" } };
/** Where a readout time is from -> what is said of it. @type {Record<string, (readout: any) => string>} */
const SOURCES = {
  motion: words.readoutEstimated,
  regression: words.readoutEstimated,
  "table of cameras": words.readoutListed,
  "usual value": words.readoutListed,
  "the clip's file": words.readoutInFile,
};

/** @extends {Panel<Clip>} */
export class ClipControls extends Panel {
  /** @param {HTMLElement} panel where to @param {On} on */
  constructor(panel, on) {
    super(panel, "clip", on, "saveClip", [UNITS.ms, UNITS.ratio]);
    this.state = "";
    this.unit = select("clip-readout-unit", words.readoutTime, words.readoutTimeOf, (unit) => this.#setUnit(unit));
    this.valueSaid = make("span");
    this.onlySaved = { stabilize: quiet(words.clipOnlySaved.stabilize), model: quiet(words.clipOnlySaved.model) };
    const set = (/** @type {string} */ value) => this.set(UNITS[this.unit.field.value], value);
    this.value = number("clip-readout", this.valueSaid, LIMITS.ms, set);
    this.camera = this.form.control("camera");
    this.source = make("p.quiet", { role: "status" });
    const fields = [this.unit.node, this.value.node, this.camera.node, this.source];
    const readout = make("div", ...fields, quiet(words.readoutTimeHelp));
    const steady = [this.control("stabilize"), this.onlySaved.stabilize];
    const first = [this.control("strength"), readout, this.control("edges"), this.control("crf")];
    const part = make("fieldset", make("legend", words.partOf), this.control("start"), this.control("end"));
    const advanced = [this.control("reference"), ...this.#others()];
    const sections = [section("advanced", {}, ...advanced), this.buttons("clipToAll", "clipReset")];
    this.fill("clipNotYet", [...first, part, ...sections, keys(words.clipKeyList)], steady);
  }

  /** Shows what a clip's options are, and what is known of it. @param {Clip} clip */
  show(clip) {
    const { options, readout, state, facts } = clip;
    const begins = state === "asking" && this.state !== "asking";
    if (clip !== this.item) this.unit.field.value = unitOf(options);
    else if (begins && this.unit.field.value === "find") this.unit.field.value = "ms"; // which it needs
    super.show(clip);
    this.state = state;
    if (facts) showEncoders(this.form, facts.encoders, options);
    const dense = options.model === "dense";
    const borrow = /** @type {HTMLOptionElement} */ (this.form.field("edges").querySelector("[value=borrow]"));
    borrow.hidden = !dense;
    this.form.field("zoom-limit").disabled = !options.stabilize;
    this.onlySaved.stabilize.hidden = !options.stabilize;
    this.onlySaved.model.hidden = !dense;
    this.#showReadout(options);
    this.source.textContent = readout ? (SOURCES[readout.found_by]?.(readout) ?? "") : "";
    const lines = said(clip).map((line) => make("p", line));
    this.say(lines, !["asking", "failed"].includes(state) && facts !== null && readout !== null, state !== "failed");
  }

  /** @param {string} name @param {string} value @param {boolean} [dragged] */
  set(name, value, dragged) {
    if (dragged) return; // a draft would take too long
    const others = { codec: ["crf", "bitrate", "preset"], crf: ["bitrate"], bitrate: ["crf"] }[name] ?? [];
    for (const other of others) this.item?.set(other, ""); // which are of the other, or exclude it
    if (name === "stabilize" && !value) this.item?.set("zoom-limit", ""); // which needs it
    super.set(name, value);
  }

  reset() {
    this.unit.field.value = "find";
    super.reset();
  }

  /** @param {Options} options */
  #showReadout(options) {
    const { value: unit } = this.unit.field;
    const { node, field } = this.value;
    node.hidden = !(unit in LIMITS);
    this.camera.node.hidden = unit !== "camera";
    this.valueSaid.textContent = unit === "ms" || unit === "ratio" ? words.readoutValueOf[unit] : "";
    Object.assign(field, LIMITS[unit]);
    if (document.activeElement !== field) field.value = options[UNITS[unit]] ?? "";
  }

  /** @param {string} unit */
  #setUnit(unit) {
    const clip = /** @type {Clip} */ (this.item);
    const known = Object.values(UNITS).some((name) => name in clip.options);
    for (const name of Object.values(UNITS)) clip.set(name, "");
    this.show(clip);
    const { field } = unit === "camera" ? this.camera : this.value;
    if (unit === "find") this.on.refresh();
    else if (known || !field.value) field.focus();
  }

  /** The others, with what is not shown of them before the clip is saved. */
  #others() {
    /** @type {Record<string, HTMLElement>} */
    const after = this.onlySaved;
    return this.form.rest().flatMap(({ name, node }) => (name in after ? [node, after[name]] : [node]));
  }
}

/** @param {Options} options */
const unitOf = (options) => Object.keys(UNITS).find((unit) => UNITS[unit] in options) ?? "find";

/** What was done at the moment that is shown, a sentence each. @param {Clip} clip */
function said({ state, result, error, options, facts, readout }) {
  if (state === "asking") return [words.sentence(error), words.sayReadout];
  if (!result || !facts) return [];
  const moved = result.changed ? words.clipMoved(result.largest_px) : words.clipAlone(result.reason);
  const lines = [options.strength === "0" ? words.clipStrength0 : moved];
  if (!readout) lines.push(words.clipFirst);
  if (result.edges === "crop") lines.push(words.clipCrop);
  return [...lines, words.clipIs(words.time(facts.duration_s), facts)];
}
