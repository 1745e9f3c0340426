// A photo on the page: its file, what the user said of it, and what the program made of it.

import { ask, close, query, Refused, send, told } from "./api.js";

const SMALL = 320;
const WITH_NEIGHBOURS = ["edges", "reference", "format", "readout"]; // options that go with them
const TRIES_AGAIN_MS = 1000;

export class Photo extends EventTarget {
  id = null; // that the program gave it; null: it has to be sent (again)
  options = {}; // name of the field -> text, as on the command line; only what differs from the defaults
  state = "waiting"; // waiting, loading, finding, done, failed
  loaded = 0;
  error = "";
  facts = null; // what its file says
  result = null; // what was found and done
  pictures = {}; // before, after -> {blob, longest}
  level = null; // the level line: [[x, y], [x, y]], shares of width and height

  neighbours = {}; // before, after -> another Photo, taken just then
  ratio = ""; // of the neighbours: readout time / time from frame to frame

  constructor(file) {
    super();
    this.file = file;
    this.name = file.name || "photo";
  }

  // Changes an option, "" for its default. Whoever shows the photo asks for it anew.
  set(name, value) {
    if (value === "" || value === null) delete this.options[name];
    else this.options[name] = String(value);
  }

  // Brings the pictures before and after to the wanted size; tells "change" on the way.
  async show(longest, later, part = "both") {
    const asked = { longest, ...(later ? { later: 1 } : {}) };
    try {
      await this.#send();
      if (part === "both") this.#become("finding");
      await Promise.all([
        part === "both" ? this.#fetch("before", asked) : null,
        this.#fetch("after", asked),
      ]);
      this.#become("done");
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.error = error.message;
      this.#become("failed");
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
    const kept = Object.entries(this.options).filter(([name]) => WITH_NEIGHBOURS.includes(name));
    const ids = Object.entries(this.neighbours).map(async ([which, photo]) => [which, await photo.sent()]);
    const known = this.ratio === "" ? [] : [["readout-ratio", this.ratio]];
    return Object.fromEntries([...kept, ...known, ...(await Promise.all(ids))]);
  }

  // Its id, once the program has it.
  async sent() {
    await this.#send();
    return this.id;
  }

  small = (later) => this.show(SMALL, later);

  // The answer to a question about this photo; sends it anew if the program has forgotten it.
  async ask(what, more = {}) {
    for (;;) {
      await this.#send();
      const options = what === "before" ? {} : await this.asked();
      try {
        return await ask(`/api/photos/${this.id}/${what}?${query({ ...options, ...more })}`);
      } catch (error) {
        if (!(error instanceof Refused) || error.status !== 404) throw error;
        for (const photo of [this, ...Object.values(this.neighbours)]) photo.id = null;
      }
    }
  }

  async #fetch(which, asked) {
    const answer = await this.ask(which, asked);
    const blob = await answer.blob();
    this.pictures[which] = { blob, longest: asked.longest };
    if (which === "before") this.facts = told(answer);
    else this.result = told(answer);
    this.#tell();
  }

  #sending = null;

  #send() {
    if (this.id === null) this.#sending ??= this.#sendNow().finally(() => (this.#sending = null));
    return this.#sending;
  }

  async #sendNow() {
    for (;;) {
      try {
        this.#become("loading");
        this.id = await send(this.file, (share) => {
          this.loaded = share;
          this.#tell();
        });
        return;
      } catch (error) {
        if (![0, 429, 503].includes(error.status)) throw error;
        await new Promise((done) => setTimeout(done, TRIES_AGAIN_MS)); // it is not there, or busy
      }
    }
  }

  forget() {
    for (const photo of Object.values(this.neighbours)) photo.forget();
    if (this.id !== null) close(this.id);
    this.id = null;
  }

  #become(state) {
    this.state = state;
    this.#tell();
  }

  #tell() {
    this.dispatchEvent(new Event("change"));
  }
}
