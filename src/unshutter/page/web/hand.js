// By hand: how far the photo leans, bends and turns, by dragging it or as numbers; and lines drawn on it.

import { about } from "./described.js";
import { KINDS } from "./lines.js";
import { make, refill } from "./nodes.js";
import { button } from "./widgets.js";
import { words } from "./words.js";

const degrees = (slope) => (Math.atan(slope) * 180) / Math.PI;
const slope = (angle) => Math.tan((angle * Math.PI) / 180);

// Tool -> the option that it sets, the number that it starts at in the result, and the number once what is near a border
// (bend: in the middle) is pulled to the right by a share of the rows.
const PULLS = {
  lean: { option: "lean-deg", start: "lean_deg", pulled: (lean, share) => degrees(slope(lean) + 2 * share) },
  bend: { option: "bend-percent", start: "bend_percent", pulled: (bend, share) => bend - 100 * share },
  turn: { option: "turn-deg", start: "turn_deg", pulled: (turn, share) => turn + degrees(share) },
};
const STEP = 0.1; // of all of them
const ACROSS = {
  // readout -> what is to the right, where that is turned downwards
  "top-to-bottom": "left-to-right",
  "bottom-to-top": "right-to-left",
  "left-to-right": "bottom-to-top",
  "right-to-left": "top-to-bottom",
};
const VECTORS = { down: [0, 1], up: [0, -1], right: [1, 0], left: [-1, 0] };
const ORIGINS = { first: 0, middle: 0.5, last: 1 }; // reference row -> place along the readout

export class ByHand {
  tool = null; // that a press on the picture goes to: a name of PULLS or KINDS

  // lines: the editor on the stage; on: {draft, change, tool, undo} called while a number changes, when something was
  // set, with the tool that is taken, and when the last step shall be taken back.
  constructor(lines, on) {
    this.lines = lines;
    this.stage = lines.stage;
    this.on = on;
    this.photo = null;
    this.tools = Object.fromEntries(
      [...Object.keys(PULLS), ...KINDS].map((name) => [
        name,
        make(
          "button",
          {
            type: "button",
            id: `tool-${name}`,
            class: `tool ${name}`,
            "aria-pressed": "false",
            title: words.toolHelp[name],
            onclick: (event) => this.#pick(name, event.detail === 0),
          },
          words.tool[name],
        ),
      ]),
    );
    this.list = make("ul", { class: "lines-list" });
    this.numbers = Object.keys(PULLS).map((name) => this.#number(name));
    this.reset = button("resetHand", () => this.#reset());
    this.undo = button("undoHand", () => on.undo());
    this.reset.title = words.resetHandHelp;
    this.undo.title = words.undoHandHelp;
    this.node = make(
      "details",
      { class: "section", id: "by-hand" },
      make("summary", {}, words.byHand),
      make("p", { class: "quiet" }, words.byHandHelp),
      ...this.numbers.map(({ node }) => node),
      make("div", { class: "row" }, ...KINDS.map((kind) => this.tools[kind])),
      this.list,
      make("div", { class: "row" }, this.undo, this.reset),
    );
    this.node.addEventListener("toggle", () => !this.node.open && this.#pick(null));
  }

  show(photo) {
    if (photo !== this.photo) this.#pick(null);
    this.photo = photo;
    const troubles = photo.lineTroubles;
    this.lines.show(photo.lines, troubles);
    const numbers = {};
    refill(
      this.list,
      photo.lines.map(({ kind }, k) => {
        numbers[kind] = (numbers[kind] ?? 0) + 1;
        const trouble = troubles[k] ? [make("span", { class: "wrong" }, words.lineTrouble[troubles[k]])] : [];
        return make(
          "li",
          { class: kind },
          `${words.lineOf[kind]} ${numbers[kind]}`,
          ...trouble,
          make(
            "button",
            {
              type: "button",
              "aria-label": words.lineRemove(words.lineOf[kind], numbers[kind]),
              onclick: () => this.lines.remove(k),
            },
            "×",
          ),
        );
      }),
    );
    for (const { show } of this.numbers) show();
    this.#shear();
    this.reset.disabled = !photo.byHand;
    this.undo.disabled = !photo.undoable;
  }

  // Opens it with the simplest tool in the hand.
  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "start" });
    if (!this.pulls && this.photo.result?.shape) this.#pick("lean");
    this.tools.lean.focus({ preventScroll: true });
  }

  stop() {
    this.#pick(null);
  }

  // Whether a tool that pulls the picture is taken.
  get pulls() {
    return this.tool in PULLS;
  }

  // A fine step of the tool that is taken, in the direction of an arrow key.
  nudge(steps) {
    if (!this.photo.result?.shape) return;
    this.#set(this.tool, Number(this.#value(this.tool)) + (this.tool === "bend" ? -steps : steps) * STEP);
    this.on.change();
  }

  #pick(name, byKeyboard = false) {
    this.tool = name === this.tool ? null : name;
    this.lines.kind = KINDS.includes(this.tool) ? this.tool : null;
    if (this.pulls) Object.assign(this.stage, { mode: "pulling", tool: (event) => this.#pull(event) });
    for (const [each, tool] of Object.entries(this.tools)) tool.setAttribute("aria-pressed", each === this.tool);
    this.on.tool(this.tool);
    if (this.lines.kind && byKeyboard) this.lines.add(this.lines.kind);
  }

  // A number as it was set, or else as it was found.
  #value(name) {
    const { option, start } = PULLS[name];
    return this.photo.hand[option] ?? this.photo.result?.shape?.[start] ?? 0;
  }

  #set(name, value) {
    const { minimum, maximum } = about("photo", PULLS[name].option);
    this.photo.setHand(PULLS[name].option, String(Number(Math.min(Math.max(value, minimum), maximum).toFixed(2))));
    this.reset.disabled = this.undo.disabled = false;
  }

  // Directions in the picture: along the readout, and across it, as arrows and vectors.
  get #axes() {
    const {
      facts: { arrows },
      result: { readout },
    } = this.photo;
    return { along: VECTORS[arrows[readout]], across: VECTORS[arrows[ACROSS[readout]]] };
  }

  // The picture is pulled: near its last rows to one side, near its first to the other.
  #pull(event) {
    if (!this.photo.result?.shape) return true;
    const [name, { along, across }] = [this.tool, this.#axes];
    const { width, height } = this.stage.box;
    const rows = along[0] ? width : height;
    const at = this.stage.shares(event);
    const late = (at[0] - 0.5) * along[0] + (at[1] - 0.5) * along[1] > 0;
    const began = Number(this.#value(name));
    let share = 0;
    this.stage.drag(
      event,
      (dx, dy) => {
        share += (dx * across[0] + dy * across[1]) / rows;
        this.#set(name, PULLS[name].pulled(began, name === "bend" || !late ? share : -share));
        for (const { show } of this.numbers) show();
        if (name === "lean") this.#shear();
        else this.on.draft();
      },
      () => share && this.on.change(),
    );
    return true;
  }

  // Shows at once how the picture leans, from the one that is shown: the true one comes a little later.
  #shear() {
    const { result, facts, options } = this.photo;
    const more =
      this.tool === "lean" && result?.shape && facts ? slope(this.#value("lean")) - slope(result.shape.lean_deg) : 0;
    if (Math.abs(more) < 1e-4) return this.stage.shear(null);
    const { along, across } = this.#axes;
    const by = -more * (options.strength ?? 1);
    const matrix = [
      1 + by * across[0] * along[0],
      by * across[1] * along[0],
      by * across[0] * along[1],
      1 + by * across[1] * along[1],
    ];
    const from = along.map((part) => `${50 + 100 * part * (ORIGINS[options.reference ?? "first"] - 0.5)}%`);
    this.stage.shear(matrix, from.join(" "));
  }

  // The button of a tool, and the number that it changes.
  #number(name) {
    const { minimum: min, maximum: max, description: title } = about("photo", PULLS[name].option);
    const field = make("input", {
      type: "number",
      id: `${name}-number`,
      min,
      max,
      step: STEP,
      title,
      "aria-label": words.tool[name],
    });
    field.addEventListener("change", () => {
      if (field.value === "" || !field.checkValidity()) return;
      this.#set(name, field.value);
      this.on.change();
    });
    const show = () => {
      field.disabled = this.tools[name].disabled = !this.photo.result?.shape;
      const rounded = Number(this.#value(name)).toFixed(1);
      if (document.activeElement !== field) field.value = rounded === "-0.0" ? "0.0" : rounded;
    };
    return { show, node: make("div", { class: "field" }, this.tools[name], field) };
  }

  #reset() {
    this.photo.resetHand();
    this.show(this.photo);
    this.on.change();
  }
}
