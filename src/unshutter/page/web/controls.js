// The panel beside a photo: what was done, in words; what the user can say; saving.

/** @import { Lines } from "./lines.js" @import { Photo } from "./photo.js" @import { On as HandOn } from "./hand.js" */
/** @import { On as PanelOn } from "./panel.js" @import { Readout } from "./types.js" */

import { curves } from "./curves.js";
import { ByHand } from "./hand.js";
import { GROUPS, Neighbours } from "./neighbours.js";
import { make } from "./nodes.js";
import { Panel } from "./panel.js";
import { goesWithNeighbours } from "./photo.js";
import { button, check, keys, quiet, row, section } from "./widgets.js";
import { words } from "./words.js";

const ARROWS = { auto: "?", down: "↓", up: "↑", right: "→", left: "←" };
const WAYS = /** @type {(keyof typeof ARROWS)[]} */ (Object.keys(ARROWS));

/** @typedef {PanelOn & HandOn & { toggleLines(): void, saveMotion(): void }} On */

/** @extends {Panel<Photo>} */
export class Controls extends Panel {
  /** @param {HTMLElement} panel where to @param {Lines} lines the editor on the stage @param {On} on */
  constructor(panel, lines, on) {
    super(panel, "photo", on, "saveOne", ["readout", "candidate", "min-confidence"]);
    this.drafts = on;
    this.motion = make("div");
    this.hand = new ByHand(lines, on);
    this.neighbours = new Neighbours(on);
    this.saveMotion = button("saveMotion", () => on.saveMotion());
    this.anyway = check("anyway", words.anyway, (yes) => this.set("min-confidence", yes ? "0" : ""));
    this.leave = check("leave", words.leave, (yes) => {
      this.item?.leave(yes);
      on.refresh();
    });
    this.readouts = WAYS.map((value) =>
      make("input", { type: "radio", name: "readout", value, onchange: () => this.#readOut(value) }),
    );
    const first = [this.control("strength"), this.control("upright"), this.leave.node, this.control("moving")];
    const corrections = [...first, this.anyway.node, this.control("edges"), this.control("format")];
    const advanced = [this.control("reference"), this.#sensor(), this.#attitude(), ...this.#others()];
    const motion = [
      make("h3", words.curves),
      this.motion,
      row(
        this.saveMotion,
        button("linesFound", () => on.toggleLines()),
      ),
    ];
    this.fill("nothingChanged", [
      ...corrections,
      this.hand.node,
      this.neighbours.node,
      section("advanced", { id: "advanced" }, ...advanced, ...motion),
      this.buttons("toAll", "reset"),
      keys(words.keyList),
    ]);
  }

  /** Shows what a photo's options are, and what came out. @param {Photo} photo */
  show(photo) {
    super.show(photo);
    const { options, result, facts, state, between } = photo;
    this.form.disable((name) => between && !goesWithNeighbours(name));
    this.form.field("upright").disabled ||= photo.byHand;
    const borrow = /** @type {HTMLOptionElement} */ (this.form.field("edges").querySelector("[value=borrow]"));
    borrow.hidden = !between;
    Object.assign(this.anyway.field, { checked: options["min-confidence"] === "0", disabled: between });
    this.leave.field.checked = photo.leftAlone;
    const arrow = facts?.arrows[/** @type {Readout} */ (options.readout)] ?? "auto";
    for (const radio of this.readouts) Object.assign(radio, { disabled: !facts, checked: radio.value === arrow });
    this.saveMotion.disabled = between || !result; // no motion of the camera alone
    this.hand.show(photo);
    this.neighbours.show(photo);
    const savable = state !== "failed" && Boolean(result?.changed || (result && options.format));
    this.say(state === "failed" ? [] : said(photo), savable, state === "done");
    this.motion.replaceChildren(...(result?.tx_px && result.rz_deg ? [curves(result.tx_px, result.rz_deg)] : []));
  }

  /** @param {string} name @param {string} value @param {boolean} [dragged] */
  set(name, value, dragged) {
    if (!dragged) return super.set(name, value);
    this.item?.set(name, value);
    this.drafts.draft();
  }

  /** The sensor was read in the direction of an arrow of the picture. @param {string} value */
  #readOut(value) {
    const named = Object.entries(this.item?.facts?.arrows ?? {}).find(([, arrow]) => arrow === value);
    this.set("readout", named?.[0] ?? "");
  }

  #sensor() {
    const drawn = WAYS.map((way, k) => {
      const sign = make(`span.sensor.${way}`, { "aria-hidden": "true" }, ARROWS[way]);
      const said = words.readoutOf[way];
      return make("label.arrow", { title: said }, this.readouts[k], sign, make("span.away", said));
    });
    return make("fieldset", make("legend", words.readout), row(...drawn), quiet(words.readoutHelp));
  }

  #attitude() {
    const angles = [this.control("roll-deg"), this.control("tilt-deg")];
    return make("fieldset", make("legend", words.attitude), quiet(words.attitudeHelp), ...angles);
  }

  #others() {
    const made = this.form.rest((group) => !["byhand", ...GROUPS].includes(group));
    return made.map(({ node }) => node);
  }
}

/** What was done to a photo: how sure that is, and a sentence each. @param {Photo} photo */
function said(photo) {
  const { result } = photo;
  if (!result) return [];
  const lines = (result.changed ? changes(photo) : [unchanged(photo)]).map((line) => make("p", line));
  const { roll_deg: roll = null, tilt_deg: tilt = null, from = "" } = result.attitude ?? {};
  if (roll !== null || tilt !== null) lines.push(make("p", words.heldSo(roll, tilt, from)));
  if (result.film) lines.push(make("p", words.videoUnused(result.film.sentence)));
  const formats = (result.changed && photo.facts?.hdr_formats) || [];
  if (formats.length && [undefined, "", ...formats].includes(photo.options.format)) lines.push(quiet(words.hdrKept));
  const sure = result.changed && !result.code && !photo.byHand && result.certainty;
  if (!sure) return lines;
  if (result.doubted) lines.push(quiet(words.doubtedHelp));
  const title = words.confidence(result.confidence);
  return [make("p.sureness", { "data-sure": sure, title }, words.sureAtLength(sure, result.doubted)), ...lines];
}

/** @param {Photo} photo */
const unchanged = ({ leftAlone, result }) => (leftAlone ? words.youLeftAlone : words.leftAlone(result?.reason));

/** @param {Photo} photo */
function changes({ byHand, result }) {
  /** @type {string[]} */
  const lines = [];
  if (!result) return lines;
  if (result.upright) lines.push(words.turnedUpright(result.upright));
  const moved = result.neighbours ? words.moment : byHand ? words.movedByHand : words.moved;
  if (!result.code) lines.push(moved(result.largest_px));
  if (result.edges === "borrow") lines.push(words.edgesBorrow);
  if (result.edges === "keep") lines.push(words.edgesKeep(result.area_left));
  else if ((result.area_left ?? 1) < 1) lines.push(words.edgesCrop(result.area_left));
  if (result.little_left) lines.push(words.littleLeft);
  if (result.edges === "fill") lines.push(words.edgesFill);
  return lines;
}
