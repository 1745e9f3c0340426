// A file that is open on the page: it is sent to the program, and asked about there.

import { ask, close, query, Refused, send } from "./api.js";

const TRIES_AGAIN_MS = 1000;

export class Opened extends EventTarget {
  id = null; // that the program gave it; null: it has to be sent (again)
  options = {}; // name of the field -> text, as on the command line; only what differs from the defaults
  state = "waiting"; // waiting, loading, finding, done, failed; of clips also opened and asking
  loaded = 0;
  error = "";
  facts = null; // what its file says
  result = null; // what was found and done
  pictures = {}; // before, after -> {blob, longest}
  saved = ""; // the wishes with which it was saved last
  #sending = null;

  // address: of its kind in the program's API.
  constructor(file, address) {
    super();
    this.file = file;
    this.address = address;
    this.name = file.name || "photo";
  }

  // Changes an option, "" for its default. Whoever shows the file asks for it anew.
  set(name, value) {
    if (value === "" || value === null || value === false) delete this.options[name];
    else this.options[name] = String(value);
  }

  // All that was asked for, as text: whether it was saved is known by it.
  get wishes() {
    return JSON.stringify(this.options);
  }

  // Whether something was done to it that has not been saved.
  get unsaved() {
    return this.state === "done" && Boolean(this.result?.changed) && !this.kept;
  }

  // Whether it was saved as it is now.
  get kept() {
    return this.saved === this.wishes;
  }

  // It was saved with these wishes.
  keep(wishes) {
    this.saved = wishes;
    this.tell();
  }

  // Its id, once the program has it.
  async sent() {
    await this.send();
    return this.id;
  }

  // The answer to a question about this file; sends it anew if the program has forgotten it.
  async askFor(what, asked, signal) {
    for (;;) {
      await this.send();
      try {
        return await ask(`${this.address}/${this.id}/${what}?${query(await asked())}`, { signal });
      } catch (error) {
        if (!(error instanceof Refused) || error.status !== 404) throw error;
        this.lose();
      }
    }
  }

  // Sends it, unless the program has it.
  send() {
    if (this.id === null) this.#sending ??= this.#sendNow().finally(() => (this.#sending = null));
    return this.#sending;
  }

  async #sendNow() {
    for (;;) {
      try {
        this.become("loading");
        this.id = await send(this.address, this.file, (share) => {
          this.loaded = share;
          this.tell();
        });
        return;
      } catch (error) {
        if (![0, 429, 503].includes(error.status)) throw error;
        await new Promise((done) => setTimeout(done, TRIES_AGAIN_MS)); // it is not there, or busy
      }
    }
  }

  // The program does not know it any more.
  lose() {
    this.id = null;
  }

  forget() {
    if (this.id !== null) close(this.address, this.id);
    this.lose();
  }

  fail(error, state = "failed") {
    if (error.name === "AbortError") return; // it is asked for again, or closed
    if (!(error instanceof Refused)) throw error;
    this.error = error.message;
    this.become(state);
  }

  become(state) {
    this.state = state;
    this.tell();
  }

  tell() {
    this.dispatchEvent(new Event("change"));
  }
}
