// The panel beside the photo: what was done, in words; what the user can say; saving.

import { curves } from "./curves.js";
import { Neighbours } from "./neighbours.js";
import { make } from "./nodes.js";
import { words } from "./words.js";

const EDGES = ["auto", "keep", "crop", "fill", "borrow"];
const ALONE = ["strength", "moving", "anyway", "horizonTrue", "roll-deg", "tilt-deg"]; // controls of a photo without neighbours
const REFERENCES = ["first", "middle", "last"];
const ARROWS = { down: "↓", up: "↑", right: "→", left: "←" };
const ABOUT_CAMERA = ["roll-deg", "tilt-deg"]; // true of one photo alone

export class Controls {
  // panel: where to; on: {change, horizon, horizonTrue, save, saveMotion, toAll} called when the user wants that.
  constructor(panel, on) {
    this.on = on;
    this.photo = null;
    this.said = make("div", { class: "said", role: "status" });
    this.motion = make("div", {});
    this.fields = {};
    this.neighbours = new Neighbours(() => on.change());
    this.saveMotion = this.#button("saveMotion", () => on.saveMotion());
    panel.replaceChildren(
      make("h2", {}, words.done), this.said,
      make("div", { class: "row" }, this.#button("saveOne", () => on.save(), "main"), this.saveMotion),
      make("h2", {}, words.settings), ...this.#undoing(), ...this.#camera(), ...this.#attitude(), this.neighbours.node,
      this.#select("format", "format", Object.keys(words.formatOf), words.formatOf, ""),
      make("div", { class: "row" }, this.#button("toAll", () => on.toAll()), this.#button("reset", () => this.#reset())),
      make("h2", {}, words.curves), this.motion, keys(),
    );
  }

  // Shows what a photo's options are, and what came out.
  show(photo) {
    this.photo = photo;
    const { options, result, facts } = photo;
    this.fields.strength.value = 100 * (options.strength ?? 1);
    this.strengthSaid.textContent = `${Math.round(100 * (options.strength ?? 1))} %`;
    this.fields.edges.value = options.edges ?? "auto";
    this.fields.format.value = options.format ?? "";
    for (const radio of this.references) radio.checked = radio.value === (options.reference ?? "first");
    this.fields.moving.checked = options.moving === "true";
    this.fields.anyway.checked = options["min-confidence"] === "0";
    this.fields.leave.checked = options.strength === "0";
    const readout = options.readout ?? "auto";
    for (const radio of this.readouts) {
      radio.disabled = !facts;
      radio.checked = radio.value === (readout === "auto" ? "auto" : facts?.arrows[readout]);
    }
    for (const name of ABOUT_CAMERA) if (document.activeElement !== this.fields[name]) this.fields[name].value = options[name] ?? "";
    for (const name of ALONE) if (this.fields[name]) this.fields[name].disabled = photo.between;
    this.horizon.disabled = !facts || photo.between;
    this.saveMotion.disabled = photo.between; // no motion of the camera alone
    this.fields.edges.querySelector("[value=borrow]").hidden = !photo.between;
    this.neighbours.show(photo);
    this.said.replaceChildren(...(result ? sentences(photo) : []).map((line) => make("p", {}, line)));
    this.motion.replaceChildren(...(result?.tx_px ? [curves(result)] : []));
  }

  set horizonShown(shown) {
    this.horizon.setAttribute("aria-pressed", shown);
    this.horizonMore.hidden = !shown;
  }

  set horizonSteep(steep) {
    this.steep.hidden = !steep;
  }

  get isTrueHorizon() {
    return this.fields.horizonTrue.checked;
  }

  #undoing() {
    const strength = make("input", { type: "range", id: "strength", min: "0", max: "100", step: "5" });
    this.strengthSaid = make("output", { for: "strength" });
    strength.addEventListener("input", () => {
      this.strengthSaid.textContent = `${strength.value} %`;
      this.#set("strength", strength.value === "100" ? "" : String(strength.value / 100));
    });
    this.fields.strength = strength;
    this.references = REFERENCES.map((value) => make("input", { type: "radio", name: "reference", value,
      onchange: () => this.#set("reference", value === "first" ? "" : value) }));
    return [
      make("label", { class: "field", for: "strength" }, words.strength, this.strengthSaid), strength,
      this.#check("leave", (on) => this.#set("strength", on ? "0" : "")),
      this.#check("moving", (on) => this.#set("moving", on ? "true" : ""), words.movingHelp),
      this.#check("anyway", (on) => this.#set("min-confidence", on ? "0" : "")),
      this.#select("edges", "edges", EDGES, words.edgesOf, "auto"),
      make("fieldset", {}, make("legend", {}, words.reference), make("div", { class: "row" },
        ...this.references.map((radio) => make("label", {}, radio, words.referenceOf[radio.value])))),
    ];
  }

  #camera() {
    const pick = (value) => {
      const name = Object.entries(this.photo.facts.arrows).find(([, arrow]) => arrow === value)?.[0];
      this.#set("readout", name ?? "");
    };
    this.readouts = ["auto", ...Object.keys(ARROWS)].map((value) =>
      make("input", { type: "radio", name: "readout", value, onchange: () => pick(value) }));
    const drawn = this.readouts.map((radio) => make("label", { class: "arrow", title: words.readoutOf[radio.value] }, radio,
      make("span", { class: `sensor ${radio.value}`, "aria-hidden": "true" }, ARROWS[radio.value] ?? "?"),
      make("span", { class: "away" }, words.readoutOf[radio.value])));
    return [make("fieldset", {}, make("legend", {}, words.readout), make("div", { class: "row" }, ...drawn),
      make("p", { class: "quiet" }, words.readoutHelp))];
  }

  #attitude() {
    const angle = (name, most, label) => {
      this.fields[name] = make("input", { type: "number", step: "0.1", min: -most, max: most, id: name,
        onchange: (event) => event.target.checkValidity() && this.#set(name, event.target.value) });
      return make("label", { class: "field", for: name }, label, this.fields[name]);
    };
    this.horizon = this.#button("horizon", () => this.on.horizon());
    this.steep = make("p", { class: "wrong", role: "alert", hidden: true }, words.horizonSteep);
    this.horizonMore = make("div", { hidden: true }, make("p", { class: "quiet" }, words.horizonHelp), this.steep,
      this.#check("horizonTrue", () => this.on.horizonTrue()));
    return [make("fieldset", {}, make("legend", {}, words.attitude),
      make("p", { class: "quiet" }, words.attitudeHelp),
      make("div", { class: "row" }, this.horizon, this.#button("forget", () => {
        this.photo.level = null;
        for (const name of ABOUT_CAMERA) this.photo.set(name, "");
        this.on.change();
      })), this.horizonMore, angle("roll-deg", 45, words.roll), angle("tilt-deg", 90, words.tilt))];
  }

  #select(name, option, values, said, usual) {
    const choices = values.map((value) => make("option", { value }, said[value]));
    this.fields[name] = make("select", { id: name, onchange: (event) =>
      this.#set(option, event.target.value === usual ? "" : event.target.value) }, ...choices);
    return make("label", { class: "field", for: name }, words[name], this.fields[name]);
  }

  #check(name, changed, help) {
    this.fields[name] = make("input", { type: "checkbox", id: name, onchange: (event) => changed(event.target.checked) });
    return make("label", { class: "check", title: help }, this.fields[name], words[name]);
  }

  #button(word, clicked, kind = "") {
    return make("button", { type: "button", id: `do-${word}`, class: kind, onclick: clicked }, words[word]);
  }

  #set(name, value) {
    this.photo.set(name, value);
    this.on.change();
  }

  #reset() {
    this.photo.options = {};
    for (const each of Object.values(this.photo.neighbours)) each.forget();
    this.photo.neighbours = {};
    this.photo.level = null;
    this.on.change();
  }
}

// Options of a photo that may hold for others, too.
export function shareable(options) {
  return Object.fromEntries(Object.entries(options).filter(([name]) => !ABOUT_CAMERA.includes(name)));
}

// What was done to a photo, a sentence each.
function sentences({ result, options }) {
  const said = [];
  if (result.changed) {
    said.push(result.neighbours ? words.moment(result.largest_px) : words.moved(result.largest_px, result.confidence));
    if (result.edges === "crop" && result.whole < 1) said.push(words.edgesCrop(result.whole));
    if (result.edges === "keep") said.push(words.edgesKeep(result.whole));
    if (result.edges === "borrow") said.push(words.edgesBorrow);
    if (result.edges === "fill") said.push(words.edgesFill);
  } else if (options.strength === "0") said.push(words.youLeftAlone);
  else {
    said.push(words.leftAlone(result.reason));
    if (result.cause === "not sure") said.push(words.notSureHint);
  }
  const { roll_deg: roll, tilt_deg: tilt, from } = result.attitude ?? { roll_deg: null, tilt_deg: null };
  if (roll !== null || tilt !== null) said.push(words.heldSo(roll, tilt, from));
  if (result.exposure_s) said.push(words.exposed(result.exposure_s));
  return said;
}

function keys() {
  const rows = words.keyList.map(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]).flat();
  return make("details", {}, make("summary", {}, words.keys), make("dl", {}, ...rows));
}
