// What to do next: with a photo that was left unchanged, what was tried, and buttons for what may help; with a tool by hand, how it is used.

import { make, refill } from "./nodes.js";
import { words } from "./words.js";

const NOT_LIKELY = ["no-rolling-shutter", "asked-for-nothing", "strength-0"]; // nothing is left to try

export class Advice {
  // node: where to; on: {moving(which way), anyway, neighbour, ratio, byHand, leaveNeighbours, done} called when the user takes an offer.
  constructor(node, on) {
    this.node = node;
    this.on = on;
  }

  // Shows what holds for a photo; nothing where it was straightened, or is still being worked on. While a tool by hand is
  // used, only how: the picture must not move under the pointer when an answer comes.
  show(photo, tool = null) {
    const lines = tool
      ? this.#using(tool)
      : photo?.kind === "photo" && photo.state === "done"
        ? this.#lines(photo)
        : [];
    this.node.classList.toggle("using", tool !== null);
    this.node.hidden = !lines.length;
    refill(this.node, lines);
  }

  #using(tool) {
    const done = make(
      "button",
      { type: "button", class: "main", id: "toolDone", title: words.toolDoneHelp, onclick: this.on.done },
      words.toolDone,
    );
    return [make("p", {}, words.toolHelp[tool]), done];
  }

  #lines(photo) {
    const { result, options } = photo;
    const lines = [];
    if (photo.neighbourError) {
      const missing = photo.neighbourCode === "ratio-unknown";
      lines.push(
        make("p", { class: "wrong" }, missing ? words.ratioMissing : words.neighbourRefused(photo.neighbourError)),
        make(
          "div",
          { class: "row" },
          missing ? this.#offer("adviceRatio", this.on.ratio) : this.#offer("adviceNeighbours", this.on.neighbour),
          this.#offer("adviceLeaveNeighbours", this.on.leaveNeighbours),
        ),
      );
    }
    if (result.changed || photo.byHand || options.strength === "0" || "candidate" in options) return lines;
    if (NOT_LIKELY.includes(result.code)) return lines;
    const anyway = options["min-confidence"] === "0";
    const tried = anyway || options.moving;
    lines.push(
      make("p", {}, tried ? words.tried(options.moving, anyway, photo.candidates.length > 1) : words.declined),
    );
    const ways = ["left", "right", "yes"].filter((way) => way !== options.moving);
    const offers = [
      make("span", {}, words.adviceWay),
      ...ways.map((way) =>
        make("button", { type: "button", id: `advice-${way}`, onclick: () => this.on.moving(way) }, words.ways[way]),
      ),
    ];
    if (result.cause === "not sure" && !anyway) offers.push(this.#offer("adviceAnyway", this.on.anyway));
    if (!Object.keys(photo.neighbours).length) offers.push(this.#offer("adviceNeighbour", this.on.neighbour));
    offers.push(this.#offer("adviceByHand", this.on.byHand));
    lines.push(make("div", { class: "row" }, ...offers));
    return lines;
  }

  #offer(word, taken) {
    return make("button", { type: "button", id: word, onclick: taken }, words[word]);
  }
}
