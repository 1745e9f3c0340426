// The panel beside a clip: what its moments say, what the user can say, saving.

import { about, control, others } from "./described.js";
import { make, refill } from "./nodes.js";
import { button, keys, number, reference, select, strength } from "./widgets.js";
import { words } from "./words.js";

const UNITS = { ms: "readout-ms", ratio: "readout-ratio", camera: "camera" }; // how a readout time is said -> the option
const LIMITS = { ms: { min: "0.1", step: "any" }, ratio: { min: "0.01", max: "1", step: "any" } };
const PLACED = [...Object.values(UNITS), "strength", "edges", "reference", "start", "end"];

export class ClipControls {
  // panel: where to; on: {change, save, toAll} called when the user wants that.
  constructor(panel, on) {
    this.on = on;
    this.clip = null;
    this.said = make("div", { class: "said", role: "status" });
    this.save = button("saveClip", () => on.save(), "main");
    this.whyNot = make("p", { class: "quiet" }, words.clipNotYet);
    this.toAll = button("clipToAll", () => on.toAll());
    const set = (name, value) => this.#set(name, value);
    const usual = (name) => control("clip", name, `clip-${name}`, set, words.choices[`clip-${name}`]);
    this.strength = strength(
      "clip-strength",
      about("clip", "strength"),
      (value, dragged) => !dragged && set("strength", value),
    );
    this.edges = usual("edges");
    this.reference = reference("clip-reference", about("clip", "reference"), (value) => set("reference", value));
    this.part = ["start", "end"].map((name) => usual(name));
    this.onlySaved = Object.fromEntries(
      Object.entries(words.clipOnlySaved).map(([name, said]) => [name, make("p", { class: "quiet" }, said)]),
    );
    const advanced = others("clip", PLACED, null, "clip-option-", set);
    this.shown = [this.strength, this.edges, this.reference, ...this.part, ...advanced];
    panel.replaceChildren(
      make("h2", {}, words.done),
      this.said,
      make("div", { class: "row actions" }, this.save, this.whyNot),
      make("h2", {}, words.settings),
      ...this.strength.nodes,
      this.#readout(),
      this.edges.node,
      make("fieldset", {}, make("legend", {}, words.partOf), ...this.part.map(({ node }) => node)),
      make(
        "details",
        { class: "section" },
        make("summary", {}, words.advanced),
        this.reference.node,
        ...advanced.flatMap(({ node, field }) => [node, this.onlySaved[field.id.replace("clip-option-", "")] ?? ""]),
      ),
      make(
        "div",
        { class: "row" },
        this.toAll,
        button("reset", () => this.#reset(), "", "clip"),
      ),
      keys(words.clipKeyList),
    );
  }

  // Shows what a clip's options are, and what is known of it.
  show(clip) {
    const asking = clip.state === "asking";
    if (clip !== this.clip) this.unit.field.value = unitOf(clip.options);
    else if (asking && this.state !== "asking" && this.unit.field.value === "find") this.unit.field.value = "ms"; // which it needs
    this.clip = clip;
    this.state = clip.state;
    const { options, readout, state } = clip;
    for (const each of this.shown) each.show(options);
    this.edges.field.querySelector("[value=borrow]").hidden = options.model !== "dense";
    this.onlySaved.stabilize.hidden = !options.stabilize;
    this.onlySaved.model.hidden = options.model !== "dense";
    const unit = this.unit.field.value;
    this.value.node.hidden = !(unit in LIMITS);
    this.camera.node.hidden = unit !== "camera";
    this.valueSaid.textContent = words.readoutValueOf[unit] ?? "";
    Object.assign(this.value.field, { max: "", ...LIMITS[unit] });
    if (document.activeElement !== this.value.field) this.value.field.value = options[UNITS[unit]] ?? "";
    this.camera.show(options);
    this.readoutSource.textContent =
      {
        motion: () => words.readoutEstimated(readout),
        "table of cameras": () => words.readoutListed(readout),
        "usual value": () => words.readoutListed(readout),
        "the clip's file": () => words.readoutInFile(readout.ms),
      }[readout?.found_by]?.() ?? "";
    this.save.disabled = asking || state === "failed" || !clip.facts || !readout;
    this.whyNot.hidden = !this.save.disabled || state === "failed";
    refill(
      this.said,
      sentences(clip).map((line) => make("p", {}, line)),
    );
  }

  #readout() {
    this.unit = select("clip-readout-unit", words.readoutTime, words.readoutTimeOf, (unit) => {
      const known = Object.values(UNITS).some((name) => name in this.clip.options);
      for (const name of Object.values(UNITS)) this.clip.set(name, "");
      this.show(this.clip);
      const field = { camera: this.camera.field, find: null }[unit] ?? this.value.field;
      if (unit === "find") this.on.change();
      else if (known || !field.value) field.focus();
    });
    this.valueSaid = make("span", {});
    this.value = number("clip-readout", this.valueSaid, LIMITS.ms, (value) =>
      this.#set(UNITS[this.unit.field.value], value),
    );
    this.camera = control("clip", "camera", "clip-camera", (name, value) => this.#set(name, value));
    this.readoutSource = make("p", { class: "quiet", role: "status" });
    return make(
      "div",
      {},
      this.unit.node,
      this.value.node,
      this.camera.node,
      this.readoutSource,
      make("p", { class: "quiet" }, words.readoutTimeHelp),
    );
  }

  #set(name, value) {
    this.clip.set(name, value);
    this.on.change();
  }

  #reset() {
    for (const name of Object.keys(this.clip.options)) this.clip.set(name, "");
    this.unit.field.value = "find";
    this.on.change();
  }
}

const unitOf = (options) => Object.keys(UNITS).find((unit) => UNITS[unit] in options) ?? "find";

// What was done at the moment that is shown, a sentence each.
function sentences({ state, result, error, options, facts, readout }) {
  if (state === "asking") return [words.sentence(error), words.sayReadout];
  if (!result || !facts) return [];
  const said = [result.changed ? words.clipMoved(result.largest_px) : words.clipAlone(words.why(result))];
  if (!readout) said.push(words.clipFirst);
  if (options.strength === "0") said.splice(0, 1, words.clipStrength0);
  if (result.edges === "crop") said.push(words.clipCrop);
  said.push(words.clipIs(words.time(facts.duration_s), facts.width, facts.height, facts.fps));
  return said;
}
