// The panel beside a clip: what its moments say, what the user can say, saving.

import { make } from "./nodes.js";
import { button, keys, number, reference, select, strength } from "./widgets.js";
import { words } from "./words.js";

const LIMITS = { ms: { min: "0.1", step: "any" }, ratio: { min: "0.01", max: "1", step: "any" } };

export class ClipControls {
  // panel: where to; on: {change, save, toAll} called when the user wants that.
  constructor(panel, on) {
    this.on = on;
    this.clip = null;
    this.said = make("div", { class: "said", role: "status" });
    this.save = button("saveClip", () => on.save(), "main");
    this.toAll = button("clipToAll", () => on.toAll());
    this.strength = strength("clip-strength", (value, dragged) => !dragged && this.#set("strength", value));
    this.edges = select("clip-edges", words.clipEdges, words.clipEdgesOf, (value) => this.#set("edges", value === "fill" ? "" : value));
    this.reference = reference("clip-reference", "middle", (value) => this.#set("reference", value));
    this.part = ["start", "end"].map((name) =>
      number(`clip-${name}`, words.part[name], { min: "0", step: "any" }, (value) => this.#set(name, value)));
    panel.replaceChildren(
      make("h2", {}, words.done), this.said, make("div", { class: "row" }, this.save),
      make("h2", {}, words.settings), ...this.strength.nodes, this.#readout(), this.edges.node, this.reference.node,
      make("fieldset", {}, make("legend", {}, words.partOf), ...this.part.map(({ node }) => node)),
      make("div", { class: "row" }, this.toAll, button("reset", () => this.#reset(), "", "clip")),
      keys(words.clipKeyList),
    );
  }

  // Shows what a clip's options are, and what is known of it.
  show(clip) {
    if (clip !== this.clip) this.unit.field.value = unitOf(clip.options);
    this.clip = clip;
    const { options, readout, state } = clip;
    this.strength.show(options);
    this.edges.field.value = options.edges ?? "fill";
    this.reference.show(options);
    const [unit, asking] = [this.unit.field.value, state === "asking"];
    this.value.node.hidden = unit === "find";
    this.valueSaid.textContent = words.readoutValueOf[unit];
    Object.assign(this.value.field, { max: "", ...LIMITS[unit] });
    if (document.activeElement !== this.value.field) this.value.field.value = options[`readout-${unit}`] ?? "";
    this.readoutSource.textContent = { motion: () => words.readoutEstimated(readout.ms, readout.ms_sd),
      "table of cameras": () => words.readoutListed(readout), "usual value": () => words.readoutListed(readout),
      "the clip's file": () => words.readoutInFile(readout.ms) }[readout?.found_by]?.() ?? "";
    this.part.forEach(({ field }, k) => {
      if (document.activeElement !== field) field.value = options[["start", "end"][k]] ?? "";
    });
    this.save.disabled = asking || state === "failed" || !clip.facts;
    this.said.replaceChildren(...sentences(clip).map((line) => make("p", {}, line)));
  }

  #readout() {
    this.unit = select("clip-readout-unit", words.readoutTime, words.readoutTimeOf, (unit) => {
      const known = Object.keys(LIMITS).some((each) => `readout-${each}` in this.clip.options);
      for (const each of Object.keys(LIMITS)) this.clip.set(`readout-${each}`, "");
      this.show(this.clip);
      if (unit === "find") this.on.change();
      else if (known || !this.value.field.value) this.value.field.focus();
    });
    this.valueSaid = make("span", {});
    this.value = number("clip-readout", this.valueSaid, LIMITS.ms, (value) => this.#set(`readout-${this.unit.field.value}`, value));
    this.readoutSource = make("p", { class: "quiet", role: "status" });
    return make("div", {}, this.unit.node, this.value.node, this.readoutSource,
      make("p", { class: "quiet" }, words.readoutTimeHelp));
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

const unitOf = (options) => Object.keys(LIMITS).find((unit) => `readout-${unit}` in options) ?? "find";

// What was done at the moment that is shown, a sentence each.
function sentences({ state, result, error, options, facts }) {
  if (state === "asking") return [`${error}.`, words.sayReadout];
  if (!result || !facts) return [];
  const said = [result.changed ? words.clipMoved(result.largest_px) : words.clipAlone(words.why(result))];
  if (options.strength === "0") said.splice(0, 1, words.clipStrength0);
  if (result.edges === "crop") said.push(words.clipCrop);
  said.push(words.clipIs(words.time(facts.duration_s), facts.width, facts.height, facts.fps));
  return said;
}
