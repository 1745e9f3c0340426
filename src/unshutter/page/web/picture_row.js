// A row of buttons with small pictures under the large one.

/** @import { Choice, Item } from "./types.js" */

import { make, refill } from "./nodes.js";
import { paint } from "./strip.js";

const SIDE = 200; // px, of the longer side

export class PictureRow {
  /** @type {Item | null} */
  #subject = null;
  /** @type {(Blob | undefined)[]} */
  #drawn = [];

  /**
   * @param {HTMLElement} node where to
   * @param {(number: number) => void} pick called with the number of the button, from 0
   */
  constructor(node, pick) {
    this.node = node;
    this.pick = pick;
    /** @type {ReturnType<PictureRow["button"]>[]} */
    this.buttons = [];
  }

  /**
   * Shows what there is to choose of a photo or clip; none: nothing.
   * @param {Item} subject @param {Choice[]} choices
   */
  fill(subject, choices) {
    this.node.hidden = !choices.length;
    if (subject !== this.#subject || this.buttons.length !== choices.length) {
      [this.#subject, this.#drawn] = [subject, []];
      this.buttons = choices.map((_, number) => this.button(number));
      this.node.replaceChildren(...this.buttons.map(({ node }) => node));
    }
    choices.forEach(({ lines, label, title = "", pressed, blob, crop, chance = null, coming = false }, number) => {
      const { node, canvas, said } = this.buttons[number];
      const bar = chance === null ? [] : [make("meter", { value: chance.toFixed(2), "aria-hidden": "true" })];
      refill(said, [...lines.map((line) => make("span.title", line)), ...bar]);
      if (label) node.setAttribute("aria-label", label);
      node.setAttribute("aria-pressed", String(pressed));
      node.title = title;
      node.classList.toggle("coming", coming);
      if (blob && blob !== this.#drawn[number]) paint(canvas, (this.#drawn[number] = blob), SIDE, crop);
    });
  }

  /** @param {number} number */
  button(number) {
    const canvas = make("canvas", { width: 1, height: 1, "aria-hidden": "true" });
    const said = make("span.lines-of-choice");
    const node = make("button.choice", { type: "button", onclick: () => this.pick(number) }, canvas, said);
    return { node, canvas, said };
  }
}
