// The moments of a clip that can be looked at: a button each, with a small picture and its time.

import { make } from "./nodes.js";
import { paint } from "./strip.js";
import { words } from "./words.js";

const SIDE = 96; // px, of the longer side

export class Moments {
  #clip = null;
  #drawn = [];

  // node: where to; pick(number): called when another moment is wanted.
  constructor(node, pick) {
    this.node = node;
    this.pick = pick;
    this.buttons = [];
  }

  // Shows those of a clip; null: none.
  show(clip) {
    this.node.hidden = !clip?.facts;
    if (this.node.hidden) return;
    if (clip !== this.#clip || this.buttons.length !== clip.facts.moments_s.length) this.#fill(clip);
    clip.facts.moments_s.forEach((time, number) => {
      const { button, canvas, said } = this.buttons[number];
      said.textContent = words.time(time);
      button.setAttribute("aria-label", words.momentAt(words.time(time)));
      button.setAttribute("aria-pressed", number === clip.moment);
      const blob = clip.smalls[number];
      if (blob && blob !== this.#drawn[number]) paint(canvas, (this.#drawn[number] = blob), SIDE);
    });
  }

  #fill(clip) {
    this.#clip = clip;
    this.#drawn = [];
    this.buttons = clip.facts.moments_s.map((_, number) => {
      const canvas = make("canvas", { width: 1, height: 1, "aria-hidden": "true" });
      const said = make("span", {});
      const button = make("button", { type: "button", class: "moment", onclick: () => this.pick(number) }, canvas, said);
      return { button, canvas, said };
    });
    this.node.replaceChildren(...this.buttons.map(({ button }) => button));
  }
}
