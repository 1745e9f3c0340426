// The panel beside a photo: what was done, in words; what the user can say; saving.

import { curves } from "./curves.js";
import { about, control, ofGroups, others } from "./described.js";
import { ByHand } from "./hand.js";
import { Neighbours } from "./neighbours.js";
import { make, refill } from "./nodes.js";
import { button, check, keys, reference, strength } from "./widgets.js";
import { words } from "./words.js";

const ALONE = ["strength", "upright", "moving", "anyway", "roll-deg", "tilt-deg"]; // controls of a photo without neighbours
const ARROWS = { down: "↓", up: "↑", right: "→", left: "←" };
const ABOUT_CAMERA = ["roll-deg", "tilt-deg"];
const OWN = [...ABOUT_CAMERA, "exposure-s", "candidate", "start", "end"]; // true of one photo or clip alone
const PLACED = [
  ...ABOUT_CAMERA,
  "strength",
  "upright",
  "edges",
  "format",
  "reference",
  "moving",
  "min-confidence",
  "readout",
  "candidate",
];
const ELSEWHERE = ["neighbours", "clock", "byhand"]; // groups of options that have a section of their own

export class Controls {
  // panel: where to; lines: the editor on the stage; on: {change, draft, tool, undo, lines, save, saveMotion, toAll} called
  // when the user wants that.
  constructor(panel, lines, on) {
    this.on = on;
    this.photo = null;
    this.said = make("div", { class: "said", role: "status" });
    this.motion = make("div", {});
    this.fields = {};
    this.shown = []; // controls that follow the options by themselves
    this.hand = new ByHand(lines, on);
    this.neighbours = new Neighbours(() => on.change());
    this.save = button("saveOne", () => on.save(), "main");
    this.whyNot = make("p", { class: "quiet" }, words.nothingChanged);
    this.saveMotion = button("saveMotion", () => on.saveMotion());
    this.toAll = button("toAll", () => on.toAll());
    this.linesShown = button("linesFound", () => on.lines());
    panel.replaceChildren(
      make("h2", {}, words.done),
      this.said,
      make("div", { class: "row actions" }, this.save, this.whyNot),
      make("h2", {}, words.settings),
      ...this.#undoing(),
      this.#control("edges"),
      this.#control("format"),
      this.hand.node,
      this.neighbours.node,
      make(
        "details",
        { class: "section", id: "advanced" },
        make("summary", {}, words.advanced),
        this.reference.node,
        ...this.#camera(),
        ...this.#attitude(),
        ...this.#others(),
        make("h3", {}, words.curves),
        this.motion,
        make("div", { class: "row" }, this.saveMotion, this.linesShown),
      ),
      make(
        "div",
        { class: "row" },
        this.toAll,
        button("reset", () => this.#reset()),
      ),
      keys(words.keyList),
    );
  }

  // Shows what a photo's options are, and what came out.
  show(photo) {
    this.photo = photo;
    const { options, result, facts } = photo;
    this.strength.show(options);
    for (const each of this.shown) each.show(options);
    this.reference.show(options);
    this.fields.anyway.checked = options["min-confidence"] === "0";
    this.fields.leave.checked = options.strength === "0" || photo.tookStill;
    const readout = options.readout ?? "auto";
    for (const radio of this.readouts) {
      radio.disabled = !facts;
      radio.checked = radio.value === (readout === "auto" ? "auto" : facts?.arrows[readout]);
    }
    for (const name of ALONE) this.fields[name].disabled = photo.between;
    this.fields.upright.disabled ||= photo.byHand;
    this.save.disabled = photo.state === "failed" || !result || !(result.changed || options.format);
    this.whyNot.hidden = !(this.save.disabled && photo.state === "done");
    this.saveMotion.disabled = photo.between || !result; // no motion of the camera alone
    this.fields.edges.querySelector("[value=borrow]").hidden = !photo.between;
    this.hand.show(photo);
    this.neighbours.show(photo);
    refill(this.said, result && photo.state !== "failed" ? sentences(photo) : []);
    this.motion.replaceChildren(...(result?.tx_px ? [curves(result)] : []));
  }

  #undoing() {
    this.strength = strength("strength", about("photo", "strength"), (value, dragged) => {
      this.photo.set("strength", value);
      if (dragged) this.on.draft();
      else this.on.change();
    });
    this.fields.strength = this.strength.field;
    this.reference = reference("reference", about("photo", "reference"), (value) => this.#set("reference", value));
    return [
      ...this.strength.nodes,
      this.#control("upright"),
      this.#check("leave", (on) => {
        this.photo.leave(on);
        this.on.change();
      }),
      this.#control("moving"),
      this.#check("anyway", (on) => this.#set("min-confidence", on ? "0" : "")),
    ];
  }

  #camera() {
    const pick = (value) => {
      const name = Object.entries(this.photo.facts.arrows).find(([, arrow]) => arrow === value)?.[0];
      this.#set("readout", name ?? "");
    };
    this.readouts = ["auto", ...Object.keys(ARROWS)].map((value) =>
      make("input", { type: "radio", name: "readout", value, onchange: () => pick(value) }),
    );
    const drawn = this.readouts.map((radio) =>
      make(
        "label",
        { class: "arrow", title: words.readoutOf[radio.value] },
        radio,
        make("span", { class: `sensor ${radio.value}`, "aria-hidden": "true" }, ARROWS[radio.value] ?? "?"),
        make("span", { class: "away" }, words.readoutOf[radio.value]),
      ),
    );
    return [
      make(
        "fieldset",
        {},
        make("legend", {}, words.readout),
        make("div", { class: "row" }, ...drawn),
        make("p", { class: "quiet" }, words.readoutHelp),
      ),
    ];
  }

  #attitude() {
    return [
      make(
        "fieldset",
        {},
        make("legend", {}, words.attitude),
        make("p", { class: "quiet" }, words.attitudeHelp),
        ...ABOUT_CAMERA.map((name) => this.#control(name)),
      ),
    ];
  }

  // Options that no other part of the panel asks for.
  #others() {
    const placed = [...PLACED, ...ELSEWHERE.flatMap((group) => ofGroups("photo", [group]))];
    const made = others("photo", placed, null, "option-", (name, value) => this.#set(name, value));
    this.shown.push(...made);
    return made.map(({ node }) => node);
  }

  #control(name) {
    const made = control("photo", name, name, (_, value) => this.#set(name, value));
    this.shown.push(made);
    this.fields[name] = made.field;
    return made.node;
  }

  #check(name, changed) {
    const { node, field } = check(name, words[name], changed);
    this.fields[name] = field;
    return node;
  }

  #set(name, value) {
    this.photo.set(name, value);
    this.on.change();
  }

  #reset() {
    this.photo.options = {};
    for (const each of Object.values(this.photo.neighbours)) each.forget();
    this.photo.neighbours = {};
    this.photo.beside = {};
    this.photo.resetHand();
    this.on.change();
  }
}

// The options of another photo or clip, once those of this one hold for it, too.
export function shared(options, others) {
  const some = (all, own) => Object.entries(all).filter(([name]) => OWN.includes(name) === own);
  return Object.fromEntries([...some(options, false), ...some(others, true)]);
}

// What was done to a photo: how sure that is, and a sentence each.
function sentences(photo) {
  const { result, options } = photo;
  const said = [];
  if (result.changed) {
    if (result.upright) said.push(words.turnedUpright(result.upright));
    if (!result.code)
      said.push(
        result.neighbours
          ? words.moment(result.largest_px)
          : photo.byHand
            ? words.movedByHand(result.largest_px)
            : words.moved(result.largest_px),
      );
    if (result.edges === "crop" && result.whole < 1) said.push(words.edgesCrop(result.whole));
    if (result.edges === "keep") said.push(words.edgesKeep(result.whole));
    if (result.edges === "borrow") said.push(words.edgesBorrow);
    if (result.edges === "fill") said.push(words.edgesFill(result.whole));
  } else if (options.strength === "0" || photo.tookStill) said.push(words.youLeftAlone);
  else said.push(words.leftAlone(words.why(result)));
  const { roll_deg: roll, tilt_deg: tilt, from } = result.attitude ?? { roll_deg: null, tilt_deg: null };
  if (roll !== null || tilt !== null) said.push(words.heldSo(roll, tilt, from));
  if (result.film) said.push(words.filmUnused(words.why(result.film)));
  const nodes = said.map((line) => make("p", {}, line));
  const sure = result.changed && !result.code && !photo.byHand ? result.certainty : "";
  if (sure === "unsure") nodes.push(make("p", { class: "quiet" }, words.unsureHelp));
  if (sure)
    nodes.unshift(
      make(
        "p",
        { class: "sureness", "data-sure": sure, title: words.confidence(result.confidence) },
        words.sureAtLength[sure],
      ),
    );
  return nodes;
}
