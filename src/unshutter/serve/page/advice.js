// What to do next with a photo that was left unchanged: why, in a sentence, and buttons for what may help.

import { make, refill } from "./nodes.js";
import { words } from "./words.js";

const NOT_LIKELY = ["no-rolling-shutter", "asked-for-nothing", "strength-0", "hovered"]; // nothing is left to try

export class Advice {
  // node: where to; on: {moving, anyway, neighbour, byHand, leaveNeighbours} called when the user takes an offer.
  constructor(node, on) {
    this.node = node;
    this.on = on;
  }

  // Shows what holds for a photo; nothing where it was straightened, or is still being worked on.
  show(photo) {
    const lines = photo?.kind === "photo" && photo.state === "done" ? this.#lines(photo) : [];
    this.node.hidden = !lines.length;
    refill(this.node, lines);
  }

  #lines(photo) {
    const { result, options } = photo;
    const lines = [];
    if (photo.neighbourError) {
      lines.push(make("p", { class: "wrong" }, words.neighbourRefused(photo.neighbourError)),
        make("div", { class: "row" }, this.#offer("adviceNeighbours", this.on.neighbour), this.#offer("adviceLeaveNeighbours", this.on.leaveNeighbours)));
    }
    if (result.changed || photo.byHand || options.strength === "0" || "candidate" in options) return lines;
    lines.push(make("p", {}, words.declined(words.why(result))));
    if (NOT_LIKELY.includes(result.code)) return lines;
    const offers = [];
    if (options.moving !== "true") offers.push(this.#offer("adviceMoving", this.on.moving));
    if (result.cause === "not sure" && options["min-confidence"] !== "0") offers.push(this.#offer("adviceAnyway", this.on.anyway));
    if (!Object.keys(photo.neighbours).length) offers.push(this.#offer("adviceNeighbour", this.on.neighbour));
    offers.push(this.#offer("adviceByHand", this.on.byHand));
    lines.push(make("div", { class: "row" }, ...offers));
    return lines;
  }

  #offer(word, taken) {
    return make("button", { type: "button", id: word, onclick: taken }, words[word]);
  }
}
