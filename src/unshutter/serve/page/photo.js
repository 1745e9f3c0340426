// A photo on the page: its file, what the user said of it, and what the program made of it.

import { factsIn } from "./api.js";
import { Opened } from "./opened.js";

const SMALL = 320;
const WITH_NEIGHBOURS = ["edges", "reference", "format", "readout"]; // options that go with them

export class Photo extends Opened {
  kind = "photo";
  level = null; // the level line: [[x, y], [x, y]], shares of width and height
  neighbours = {}; // before, after -> another Photo, taken just then
  beside = {}; // options that are for a photo with neighbours alone: name of the field -> text

  constructor(file) {
    super(file, "/api/photos");
  }

  // Brings the pictures before and after to the wanted size; tells "change" on the way.
  async show(longest, later, part = "both") {
    const asked = { longest, ...(later ? { later: 1 } : {}) };
    try {
      await this.send();
      if (part === "both") this.become("finding");
      await Promise.all([
        part === "both" ? this.#fetch("before", asked) : null,
        this.#fetch("after", asked),
      ]);
      this.become("done");
    } catch (error) {
      this.fail(error);
    }
  }

  // Whether the neighbours say how the camera moved.
  get between() {
    return Object.keys(this.neighbours).length > 0 && this.options.strength !== "0";
  }

  // The options as they are asked for: what does not go with neighbours is left out where they count, and the reverse.
  async asked() {
    if (!this.between) {
      const { edges, ...others } = this.options;
      return edges === undefined || edges === "borrow" ? others : { ...others, edges };
    }
    const kept = Object.entries(this.options).filter(([name]) =>
      WITH_NEIGHBOURS.includes(name) && !(name === "reference" && "at" in this.beside)); // both say the moment
    const ids = Object.entries(this.neighbours).map(async ([which, photo]) => [which, await photo.sent()]);
    return { ...Object.fromEntries([...kept, ...(await Promise.all(ids))]), ...this.beside };
  }

  small = (later) => this.show(SMALL, later);

  // The answer to a question about this photo.
  ask(what, more = {}) {
    return this.askFor(what, async () => ({ ...(what === "before" ? {} : await this.asked()), ...more }));
  }

  async #fetch(which, asked) {
    const answer = await this.ask(which, asked);
    const blob = await answer.blob();
    this.pictures[which] = { blob, longest: asked.longest };
    if (which === "before") this.facts = factsIn(answer);
    else this.result = factsIn(answer);
    this.tell();
  }

  lose() {
    super.lose();
    for (const photo of Object.values(this.neighbours)) photo.lose();
  }

  forget() {
    for (const photo of Object.values(this.neighbours)) photo.forget();
    super.forget();
  }
}
