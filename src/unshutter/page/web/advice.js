// What to do next: with a photo that was left unchanged, what was tried, and buttons for what may help, as the program
// advises (page/sentences.py); with a tool by hand, how it is used.

/** @import { Advised, Item, Tool } from "./types.js" @import { Photo } from "./photo.js" */

import { make, refill } from "./nodes.js";
import { button, press, row } from "./widgets.js";
import { words } from "./words.js";

const WAYS = /** @type {const} */ (["left", "right", "yes"]);

/** @typedef {Parameters<typeof words.tried>[0]} Way */

/** @typedef {Exclude<Advised, "adviceWay">} Offered */
/** @typedef {{ adviceWay(way: string): void, useBurst(): void, toolDone(): void }} Others */
/** @typedef {Record<Offered, () => void> & Others} Taken */

export class Advice {
  /** @param {HTMLElement} node where to @param {Taken} on called when the user takes an offer */
  constructor(node, on) {
    this.node = node;
    this.on = on;
  }

  /**
   * Shows what holds for a photo; nothing where it was straightened, or is still being worked on. While a tool by hand
   * is used, only how: the picture must not move under the pointer when an answer comes.
   * @param {Item} item @param {Tool | null} tool
   */
  show(item, tool = null) {
    const asked = item.kind === "photo" && item.state === "done";
    const lines = tool ? this.#using(tool) : asked ? this.#lines(item) : [];
    this.node.classList.toggle("using", tool !== null);
    this.node.hidden = !lines.length;
    refill(this.node, lines);
  }

  /** @param {Tool} tool */
  #using(tool) {
    const done = button("toolDone", this.on.toolDone, { class: "main", title: words.toolDoneHelp });
    return [make("p", words.toolHelp[tool]), done];
  }

  /** @param {Photo} photo */
  #lines(photo) {
    const { result, options, trouble } = photo;
    const lines = this.#ofBurst(photo);
    if (trouble)
      lines.push(make("p.wrong", words.neighbourRefused(trouble.sentence)), this.#offers(trouble.advice, photo));
    const decided = photo.byHand || options.strength === "0" || "candidate" in options;
    if (!result || result.changed || decided || !result.advice?.length) return lines;
    const [way, anyway] = [/** @type {Way} */ (options.moving), options["min-confidence"] === "0"];
    const untried = result.advice.every((name) => name === "adviceLevel") ? words.heldAskew : words.declined;
    const said = way || anyway ? words.tried(way, anyway, photo.candidates.length > 1) : untried;
    return [...lines, make("p", said), this.#offers(result.advice, photo)];
  }

  /** What a photo of a burst is offered. @param {Photo} photo */
  #ofBurst({ burst, hasNeighbours, byHand }) {
    if (burst.length < 2 || hasNeighbours || byHand) return [];
    return [make("p", words.burst(burst.length)), row(button("useBurst", this.on.useBurst, { class: "main" }))];
  }

  /** Buttons for what is advised, unless it was tried. @param {Advised[]} advice @param {Photo} photo */
  #offers(advice, { options, hasNeighbours, result }) {
    const ways = WAYS.filter((way) => way !== options.moving);
    const directions = ways.map((way) => press(`advice-${way}`, words.ways[way], () => this.on.adviceWay(way)));
    const offers = advice.flatMap((name) => {
      if (name === "adviceWay") return [make("span", words.adviceWay), ...directions];
      if (name === "adviceLevel") {
        const said = words.adviceLevel(result?.lean_deg ?? 0, result?.lean_error_deg ?? 0);
        return [press(name, said, this.on.adviceLevel)];
      }
      if (name === "adviceAnyway" && options["min-confidence"] === "0") return [];
      if (name === "adviceNeighbour" && hasNeighbours) return [];
      return [button(name, this.on[name])];
    });
    return row(...offers);
  }
}
