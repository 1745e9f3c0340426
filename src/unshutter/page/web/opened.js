// A file that is open on the page: it is sent to the program, and asked about there.

/** @import { ClipFacts, ClipResult, Options, PhotoFacts, PhotoResult, Picture, Which } from "./types.js" */
/** @import { Event as StateEvent, State } from "./states.js" @import { Glimpse } from "./glimpse.js" */

import { ask, close, isAbort, Refused, rest, send } from "./api.js";
import { glimpse } from "./glimpse.js";
import { next } from "./states.js";

const TRIES_AGAIN_MS = 1000;

export class Opened extends EventTarget {
  /** @type {string | null} that the program gave it; null: it has to be sent (again) */
  id = null;
  /** @type {Options} only what differs from the defaults */
  options = {};
  /** @type {State} */
  state = "waiting";
  loaded = 0;
  error = "";
  /** @type {PhotoFacts | ClipFacts | null} what its file says */
  facts = null;
  /** @type {PhotoResult | ClipResult | null} what was found and done */
  result = null;
  /** @type {Partial<Record<Which, Picture>>} */
  pictures = {};
  saved = ""; // the wishes with which it was saved last
  /** @type {Promise<void> | null} */
  #sending = null;
  /** @type {Glimpse | null} a first picture, drawn by the browser */
  glimpse = null;
  looks = 0; // how often one was looked for: by the browser, and by the program

  /** @param {File} file @param {string} address of its kind in the program's API */
  constructor(file, address) {
    super();
    this.file = file;
    this.address = address;
    this.name = file.name || "photo";
  }

  /**
   * Changes an option, "" for its default. Whoever shows the file asks for it anew.
   * @param {string} name @param {string} value
   */
  set(name, value) {
    if (value === "") delete this.options[name];
    else this.options[name] = value;
  }

  /** All that was asked for, as text: whether it was saved is known by it. */
  get wishes() {
    return JSON.stringify(this.options);
  }

  /** Whether it was saved as it is now. */
  get kept() {
    return this.saved === this.wishes;
  }

  /** It was saved with these wishes. @param {string} wishes */
  keep(wishes) {
    this.saved = wishes;
    this.tell();
  }

  /**
   * The answer to a question about this file; sends it anew if the program has forgotten it.
   * @param {string} what @param {() => Promise<Record<string, string>>} asked @param {AbortSignal} [signal]
   */
  async askFor(what, asked, signal) {
    for (;;) {
      await this.send();
      try {
        return await ask(`${this.address}/${this.id}/${what}?${new URLSearchParams(await asked())}`, { signal });
      } catch (error) {
        if (!(error instanceof Refused) || error.status !== 404) throw error;
        this.lose();
      }
    }
  }

  /** Gets a first picture, if it has none: from the browser; the second time from the program, before its turn. */
  async look() {
    this.looks += 1;
    if (this.pictures.before || this.glimpse) return;
    if (this.looks === 1) {
      this.glimpse = await glimpse(this.file, this.address.endsWith("clips"));
      return this.tell();
    }
    if (this.state !== "waiting") return;
    try {
      await this.sendAhead();
      await this.firstPicture();
    } catch (error) {
      this.fail(error);
    }
  }

  /** Gets a first picture from the program. */
  async firstPicture() {}

  /** Sends it before its turn, for which it goes on waiting; returns its id. */
  async sendAhead() {
    const id = await this.send();
    this.become("wait");
    return id;
  }

  /** Sends it, unless the program has it; returns its id. */
  async send() {
    if (this.id === null) {
      this.#sending ??= this.#sendNow().finally(() => (this.#sending = null));
      await this.#sending;
    }
    return /** @type {string} */ (this.id);
  }

  async #sendNow() {
    for (;;) {
      try {
        this.become("send");
        this.id = await send(this.address, this.file, (share) => {
          this.loaded = share;
          this.tell();
        });
        return;
      } catch (error) {
        if (!(error instanceof Refused) || ![0, 429, 503].includes(error.status)) throw error;
        await rest(TRIES_AGAIN_MS); // it is not there, or busy
      }
    }
  }

  /** The program does not know it any more. */
  lose() {
    this.id = null;
  }

  forget() {
    if (this.id !== null) close(this.address, this.id);
    this.lose();
  }

  /**
   * What to do about an error; one of the page itself is thrown on.
   * @param {unknown} error @param {StateEvent} [event]
   */
  fail(error, event = "refuse") {
    if (isAbort(error)) return; // it is asked for again, or closed
    if (!(error instanceof Refused)) throw error;
    this.error = error.message;
    this.become(event);
  }

  /** @param {StateEvent} event */
  become(event) {
    this.state = next(this.state, event);
    this.tell();
  }

  tell() {
    this.dispatchEvent(new Event("change"));
  }
}
