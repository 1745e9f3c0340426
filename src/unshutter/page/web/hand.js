// By hand: how far the photo leans, bends and turns, by dragging it or as numbers; and lines drawn on it.

/** @import { Pull, Readout, Shape, Tool } from "./types.js" @import { Lines } from "./lines.js" */
/** @import { Photo } from "./photo.js" */

import { about } from "./form.js";
import { KINDS } from "./lines.js";
import { make, refill } from "./nodes.js";
import { VECTORS, within } from "./stage.js";
import { button, number, press, quiet, row, section } from "./widgets.js";
import { words } from "./words.js";

/** @param {number} slope */
const degrees = (slope) => (Math.atan(slope) * 180) / Math.PI;
/** @param {number} angle */
const slope = (angle) => Math.tan((angle * Math.PI) / 180);

/**
 * The option that a tool sets, the number that it starts at in the result, and the number once what is near a border
 * (bend: in the middle) is pulled to the right by a share of the rows.
 * @typedef {{ option: string, start: keyof Shape, pulled(before: number, share: number): number }} Pulling
 */
/** @type {Record<Pull, Pulling>} */
const PULLS = {
  lean: { option: "lean-deg", start: "lean_deg", pulled: (lean, share) => degrees(slope(lean) + 2 * share) },
  bend: { option: "bend-percent", start: "bend_percent", pulled: (bend, share) => bend - 100 * share },
  turn: { option: "turn-deg", start: "turn_deg", pulled: (turn, share) => turn + degrees(share) },
};
const PULL_NAMES = /** @type {Pull[]} */ (Object.keys(PULLS));
const STEP = 0.1; // of all of them
/** What is to the right, where the readout is turned downwards. @type {Record<Readout, Readout>} */
const ACROSS = {
  "top-to-bottom": "left-to-right",
  "bottom-to-top": "right-to-left",
  "left-to-right": "bottom-to-top",
  "right-to-left": "top-to-bottom",
};
/** @type {Record<string, number>} */
const ORIGINS = { first: 0, middle: 0.5, last: 1 }; // reference row -> place along the readout

/** @param {Tool | null} tool @returns {tool is Pull} */
const isPull = (tool) => tool !== null && tool in PULLS;
/** @param {Tool | null} tool @returns {import("./types.js").LineKind | null} */
const lineKind = (tool) => KINDS.find((kind) => kind === tool) ?? null;

/**
 * Called while a number changes, when something was set, when a tool is taken or put away, and when the last step shall
 * be taken back or done again.
 * @typedef {{ draft(): void, refresh(): void, using(): void, goBy(by: -1 | 1): void }} On
 */

export class ByHand {
  /** @type {Tool | null} that a press on the picture goes to */
  tool = null;
  /** @type {Photo | null} */
  photo = null;

  /** @param {Lines} lines the editor on the stage @param {On} on */
  constructor(lines, on) {
    this.lines = lines;
    this.stage = lines.stage;
    this.on = on;
    const tools = [...PULL_NAMES, ...KINDS].map((name) => [name, this.#tool(name)]);
    this.tools = /** @type {Record<Tool, HTMLButtonElement>} */ (Object.fromEntries(tools));
    this.list = make("ul.lines-list");
    this.numbers = PULL_NAMES.map((name) => this.#number(name));
    this.undo = button("undoHand", () => on.goBy(-1), { title: words.undoHandHelp });
    this.redo = button("redoHand", () => on.goBy(1), { title: words.redoHandHelp });
    this.reset = button("resetHand", () => this.#reset(), { title: words.resetHandHelp });
    const drawing = row(...KINDS.map((kind) => this.tools[kind]));
    const pulls = this.numbers.map(({ node }) => node);
    const parts = [quiet(words.byHandHelp), ...pulls, drawing, this.list, row(this.undo, this.redo, this.reset)];
    this.node = section("byHand", { id: "by-hand" }, ...parts);
    this.node.addEventListener("toggle", () => !this.node.open && this.stop());
  }

  /** @param {Photo} photo */
  show(photo) {
    if (photo !== this.photo) this.stop();
    this.photo = photo;
    this.lines.show(photo.lines, photo.lineTroubles);
    refill(this.list, this.#listed(photo));
    for (const { show } of this.numbers) show();
    this.#shear();
    this.reset.disabled = !photo.byHand;
    this.undo.disabled = !photo.undoable;
    this.redo.disabled = !photo.redoable;
  }

  /** @param {Photo} photo */
  #listed({ lines, lineTroubles }) {
    return lines.map(({ kind }, k) => {
      const name = words.lineOf[kind];
      const ordinal = lines.slice(0, k + 1).filter((line) => line.kind === kind).length;
      const trouble = lineTroubles[k];
      const said = trouble && make("span.wrong", words.lineTrouble[trouble]);
      const removes = { "aria-label": words.lineRemove(name, ordinal), onclick: () => this.lines.remove(k) };
      return make(`li.${kind}`, `${name} ${ordinal}`, said, make("button", { type: "button", ...removes }, "×"));
    });
  }

  /** Opens it with the simplest tool in the hand. */
  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "start" });
    if (!this.pulls && this.photo?.result?.shape) this.#pick("lean");
    this.tools.lean.focus({ preventScroll: true });
  }

  stop() {
    this.#pick(null);
  }

  /** Whether a tool that pulls the picture is taken. */
  get pulls() {
    return isPull(this.tool);
  }

  /** A fine step of the tool that is taken, in the direction of an arrow key. @param {number} steps */
  nudge(steps) {
    if (!this.photo?.result?.shape || !isPull(this.tool)) return;
    this.#set(this.tool, this.#value(this.tool) + (this.tool === "bend" ? -steps : steps) * STEP);
    this.on.refresh();
  }

  /** @param {Tool | null} name @param {boolean} byKeyboard */
  #pick(name, byKeyboard = false) {
    this.tool = name === this.tool ? null : name;
    const kind = lineKind(this.tool);
    this.lines.kind = kind;
    if (this.pulls) Object.assign(this.stage, { mode: "pulling", tool: this.#pull });
    for (const [each, tool] of Object.entries(this.tools))
      tool.setAttribute("aria-pressed", String(each === this.tool));
    this.on.using();
    if (kind && byKeyboard) this.lines.add(kind);
  }

  /** A number as it was set, or else as it was found. @param {Pull} name */
  #value(name) {
    const { option, start } = PULLS[name];
    return Number(this.photo?.hand[option] ?? this.photo?.result?.shape?.[start] ?? 0);
  }

  /** @param {Pull} name @param {number} value */
  #set(name, value) {
    const { minimum = -Infinity, maximum = Infinity } = about("photo", PULLS[name].option);
    if (this.photo) this.photo.hand[PULLS[name].option] = String(Number(within(value, minimum, maximum).toFixed(2)));
    this.reset.disabled = this.undo.disabled = false;
  }

  /** Directions in the picture: along the readout, and across it. */
  get #axes() {
    const { facts, result } = this.photo ?? {};
    if (!facts || !result) return { along: VECTORS.down, across: VECTORS.right };
    return { along: VECTORS[facts.arrows[result.readout]], across: VECTORS[facts.arrows[ACROSS[result.readout]]] };
  }

  /** The picture is pulled: near its last rows to one side, near its first to the other. @param {PointerEvent} event */
  #pull = (event) => {
    const name = this.tool;
    if (!this.photo?.result?.shape || !isPull(name)) return true;
    const { along, across } = this.#axes;
    const { width, height } = this.stage.box;
    const rows = along[0] ? width : height;
    const [x, y] = this.stage.shares(event);
    const late = (x - 0.5) * along[0] + (y - 0.5) * along[1] > 0;
    const began = this.#value(name);
    let share = 0;
    const follow = (/** @type {number} */ dx, /** @type {number} */ dy) => {
      share += (dx * across[0] + dy * across[1]) / rows;
      this.#set(name, PULLS[name].pulled(began, name === "bend" || !late ? share : -share));
      for (const { show } of this.numbers) show();
      if (name === "lean") this.#shear();
      else this.on.draft();
    };
    this.stage.drag(event, follow, () => share && this.on.refresh());
    return true;
  };

  /** Shows at once how the picture leans, from the one that is shown: the true one comes a little later. */
  #shear() {
    const { result, facts, options } = this.photo ?? {};
    const shape = this.tool === "lean" && facts && result?.shape;
    const more = shape ? slope(this.#value("lean")) - slope(shape.lean_deg) : 0;
    if (!options || Math.abs(more) < 1e-4) return this.stage.shear(null);
    const { along, across } = this.#axes;
    const by = -more * Number(options.strength ?? 1);
    const first = [1 + by * across[0] * along[0], by * across[1] * along[0]];
    const second = [by * across[0] * along[1], 1 + by * across[1] * along[1]];
    const origin = ORIGINS[options.reference ?? "first"] - 0.5;
    this.stage.shear([...first, ...second], along.map((part) => `${50 + 100 * part * origin}%`).join(" "));
  }

  /** @param {Tool} name */
  #tool(name) {
    const more = { class: `tool ${name}`, "aria-pressed": "false", title: words.toolHelp[name] };
    return press(`tool-${name}`, words.tool[name], (event) => this.#pick(name, event.detail === 0), more);
  }

  /** The button of a tool, and the number that it changes. @param {Pull} name */
  #number(name) {
    const { minimum: min, maximum: max, description: title } = about("photo", PULLS[name].option);
    const limits = { min, max, step: STEP, title, "aria-label": words.tool[name] };
    const { field } = number(`${name}-number`, "", limits, (value) => {
      if (value === "") delete this.photo?.hand[PULLS[name].option];
      else this.#set(name, Number(value));
      this.on.refresh();
    });
    const show = () => {
      field.disabled = this.tools[name].disabled = !this.photo?.result?.shape;
      const rounded = this.#value(name).toFixed(1);
      if (document.activeElement !== field) field.value = rounded === "-0.0" ? "0.0" : rounded;
    };
    return { show, node: make("div.field", this.tools[name], field) };
  }

  #reset() {
    if (!this.photo) return;
    this.photo.resetHand();
    this.show(this.photo);
    this.on.refresh();
  }
}
