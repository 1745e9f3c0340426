// A row of buttons with small pictures under the large one.

import { make, refill } from "./nodes.js";
import { paint } from "./strip.js";

const SIDE = 200; // px, of the longer side

export class PictureRow {
  #subject = null;
  #drawn = [];

  // node: where to; pick(number): called with the number of the button, from 0.
  constructor(node, pick) {
    this.node = node;
    this.pick = pick;
    this.buttons = [];
  }

  // Shows buttons of a subject: [{lines, label, title, pressed, blob, crop, chance, coming}]; none: nothing.
  show(subject, choices) {
    this.node.hidden = !choices.length;
    if (subject !== this.#subject || this.buttons.length !== choices.length) this.#fill(subject, choices);
    choices.forEach(({ lines, label, title, pressed, blob, crop, chance = null, coming = false }, number) => {
      const { button, canvas, said } = this.buttons[number];
      const bar = chance === null ? [] : [make("meter", { value: chance.toFixed(2), "aria-hidden": "true" })];
      refill(said, [...lines.map((line) => make("span", { class: "title" }, line)), ...bar]);
      if (label) button.setAttribute("aria-label", label);
      button.setAttribute("aria-pressed", pressed);
      button.title = title ?? "";
      button.classList.toggle("coming", coming);
      if (blob && blob !== this.#drawn[number]) paint(canvas, (this.#drawn[number] = blob), SIDE, crop);
    });
  }

  #fill(subject, choices) {
    this.#subject = subject;
    this.#drawn = [];
    this.buttons = choices.map((_, number) => {
      const canvas = make("canvas", { width: 1, height: 1, "aria-hidden": "true" });
      const said = make("span", { class: "lines-of-choice" });
      const button = make(
        "button",
        { type: "button", class: "choice", onclick: () => this.pick(number) },
        canvas,
        said,
      );
      return { button, canvas, said };
    });
    this.node.replaceChildren(...this.buttons.map(({ button }) => button));
  }
}
