// By hand: lines drawn on the picture, and numbers for how far it leans, bends and turns.

import { about } from "./described.js";
import { KINDS } from "./lines.js";
import { make, refill } from "./nodes.js";
import { button } from "./widgets.js";
import { words } from "./words.js";

// Slider -> the option that it sets, the number that it starts at in the result, and its range.
const SLIDERS = {
  lean: { option: "lean-deg", start: "lean_deg", most: 15, step: 0.1 },
  bend: { option: "bend-percent", start: "bend_percent", most: 10, step: 0.1 },
  turn: { option: "turn-deg", start: "turn_deg", most: 10, step: 0.1 },
};

export class ByHand {
  // lines: the editor on the stage; on: {draft, change, tool, undo} called while a slider is dragged, when something was
  // set, with the kind of line that is to be drawn, and when the last step shall be taken back.
  constructor(lines, on) {
    this.lines = lines;
    this.on = on;
    this.photo = null;
    this.tools = KINDS.map((kind) => make("button", { type: "button", id: `draw-${kind}`, class: `tool ${kind}`, "aria-pressed": "false",
      title: words.drawHelp[kind], onclick: (event) => this.#pick(kind, event.detail === 0) }, words.drawLine[kind]));
    this.list = make("ul", { class: "lines-list" });
    this.sliders = Object.keys(SLIDERS).map((name) => this.#slider(name));
    this.reset = button("resetHand", () => this.#reset());
    this.undo = button("undoHand", () => on.undo());
    this.reset.title = words.resetHandHelp;
    this.undo.title = words.undoHandHelp;
    this.node = make("details", { class: "section", id: "by-hand" }, make("summary", {}, words.byHand),
      make("p", { class: "quiet" }, words.byHandHelp), make("div", { class: "row" }, ...this.tools), this.list,
      ...this.sliders.flatMap(({ nodes }) => nodes), make("div", { class: "row" }, this.undo, this.reset));
    this.node.addEventListener("toggle", () => !this.node.open && this.#pick(null));
  }

  show(photo) {
    if (photo !== this.photo) this.#pick(null);
    this.photo = photo;
    const troubles = photo.lineTroubles;
    this.lines.show(photo.lines, troubles);
    const numbers = {};
    refill(this.list, photo.lines.map(({ kind }, k) => {
      numbers[kind] = (numbers[kind] ?? 0) + 1;
      const trouble = troubles[k] ? [make("span", { class: "wrong" }, words.lineTrouble[troubles[k]])] : [];
      return make("li", { class: kind }, `${words.lineOf[kind]} ${numbers[kind]}`, ...trouble, make("button", { type: "button",
        "aria-label": words.lineRemove(words.lineOf[kind], numbers[kind]), onclick: () => this.lines.remove(k) }, "×"));
    }));
    for (const { name, show } of this.sliders) show(photo.hand[SLIDERS[name].option] ?? photo.result?.shape?.[SLIDERS[name].start] ?? 0, !photo.result?.shape);
    this.reset.disabled = !photo.byHand;
    this.undo.disabled = !photo.undoable;
  }

  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "start" });
    this.tools[0].focus({ preventScroll: true });
  }

  stop() {
    this.#pick(null);
  }

  #pick(kind, byKeyboard = false) {
    const again = kind === this.lines.kind ? null : kind;
    this.lines.kind = again;
    this.tools.forEach((tool, k) => tool.setAttribute("aria-pressed", KINDS[k] === again));
    this.on.tool(again);
    if (again && byKeyboard) this.lines.add(again);
  }

  #slider(name) {
    const { option, most, step } = SLIDERS[name];
    const range = make("input", { type: "range", id: name, min: -most, max: most, step });
    const number = make("input", { type: "number", id: `${name}-number`, min: about("photo", option).minimum, max: about("photo", option).maximum, step, title: about("photo", option).description, "aria-label": words.slider_[name] });
    const set = (value) => {
      this.photo.setHand(option, value);
      this.reset.disabled = this.undo.disabled = false;
    };
    range.addEventListener("input", () => {
      number.value = range.value;
      set(range.value);
      this.on.draft();
    });
    range.addEventListener("change", () => this.on.change());
    number.addEventListener("change", () => {
      if (number.value === "" || !number.checkValidity()) return;
      range.value = number.value;
      set(number.value);
      this.on.change();
    });
    const show = (value, unknown) => {
      range.disabled = number.disabled = unknown;
      const rounded = Number(value).toFixed(1);
      if (document.activeElement !== range) range.value = rounded;
      if (document.activeElement !== number) number.value = rounded === "-0.0" ? "0.0" : rounded;
    };
    return { name, show, nodes: [make("label", { class: "field", for: name }, words.slider_[name], number), range] };
  }

  #reset() {
    this.photo.resetHand();
    this.show(this.photo);
    this.on.change();
  }
}
