// A clip on the page: some moments of it are looked at, before and after, and then the whole of it is saved.

/** @import { ClipFacts, ClipResult, Doing, Longest, Options, ReadoutTime, Which } from "./types.js" */

import { factsIn, Refused } from "./api.js";
import { ofGroups } from "./form.js";
import { Opened } from "./opened.js";
import { videos } from "./options.js";
import { doing } from "./saving.js";
import { WRONG } from "./states.js";
import { words } from "./words.js";

const SMALL = 320;
const PART = ["start", "end"]; // options that say which part of the clip is kept
const SEARCHED = [...PART, ...ofGroups("clip", ["shutter"])]; // by which the search for the readout time goes
const LOOK_MS = 500; // between looks at how far it is
/** @type {Doing} */
const NOTHING = { share: 0, left: "" };

/** @param {File} file */
export const isClip = ({ type, name }) =>
  type.startsWith("video/") || videos.some((ending) => name.toLowerCase().endsWith(ending));

export class Clip extends Opened {
  kind = /** @type {const} */ ("clip");
  /** @type {ClipFacts | null} */
  facts = null;
  /** @type {ClipResult | null} */
  result = null;
  moment = 2; // which of the five is shown: the middle one
  /** @type {Blob[]} small pictures of all moments */
  smalls = [];
  /** @type {Blob | null} before and after, moving */
  video = null;
  filming = false; // whether that is being made
  /** @type {ReadoutTime | null} what is known of the camera's readout time */
  readout = null;
  doing = NOTHING; // how far the search for it is, or the video, and how long that still takes
  /** @type {Blob[] | null} the small pictures that are on their way */
  #drawing = null;
  #work = new AbortController(); // of what the program does now
  #cancelled = false;
  #turn = 0; // of the pictures that are asked for: answers of an earlier turn do not count
  /** @type {Promise<ReadoutTime> | null} the search for the readout time */
  #search = null;

  /** @param {File} file */
  constructor(file) {
    super(file, "/api/clips");
  }

  /**
   * Brings the pictures of the moment to the wanted size: the frame at once, a first look with the usual readout time
   * (unless it is later that somebody looks), and what the clip's own gives.
   * @param {Longest} longest @param {boolean} [later] @param {"both" | "after"} part
   */
  async show(longest, later, part = "both") {
    const turn = ++this.#turn;
    const fetch = (/** @type {Which} */ which, /** @type {Options} */ more = {}) =>
      this.#fetch(which, longest, more, () => turn === this.#turn);
    try {
      await this.send();
      this.become("look");
      if (part === "both") await fetch("before", later ? { later: "1" } : {});
      this.#drawSmall(); // the frames are there long before their motion is
    } catch (error) {
      return this.fail(error);
    }
    try {
      if (this.#cancelled) throw new Refused(0, words.stopped);
      if (!this.readout) {
        if (!later) await fetch("after", { usual: "1" }).catch(unlessRefused); // the search says what is wrong
        this.#search ??= this.#followed(async () => (await this.#ask("readout")).json());
        this.readout = await this.#search;
      }
      await fetch("after");
      this.become("answer");
    } catch (error) {
      const failure = this.#cancelled ? new Refused(0, words.stopped) : error;
      if (failure instanceof Refused) {
        this.readout = this.result = this.#search = null;
        delete this.pictures.after;
      }
      this.fail(failure, "ask"); // the clip can be read: it is the settings that do not do
    }
  }

  /**
   * The answer to a question that takes long; until it comes, looks how far it is.
   * @template T @param {() => Promise<T>} asked
   */
  async #followed(asked) {
    const look = async () => {
      this.doing = doing(await (await this.#ask("progress")).json());
      this.tell();
    };
    this.doing = NOTHING;
    const looking = setInterval(() => look().catch(() => {}), LOOK_MS); // it may end meanwhile
    try {
      return await asked();
    } finally {
      clearInterval(looking);
    }
  }

  /**
   * Counts says whether the answer is still the one that is waited for.
   * @param {Which} which @param {Longest} longest @param {Options} more @param {() => boolean} counts
   */
  async #fetch(which, longest, more, counts = () => true) {
    const { pictures, moment } = this;
    const answer = await this.#ask(which, { moment: String(moment), longest: String(longest), ...more });
    const blob = await answer.blob();
    if (!counts()) return;
    pictures[which] = { blob, longest };
    if (pictures === this.pictures) this[which === "before" ? "facts" : "result"] = factsIn(answer);
    this.tell();
  }

  /** Stops what the program does for the clip. */
  stop() {
    this.#search = null;
    this.#work.abort();
    this.#work = new AbortController();
    this.#drawing = null;
  }

  cancel() {
    this.#cancelled = !this.filming; // then the search is not begun again by itself
    this.stop();
  }

  forget() {
    this.stop();
    super.forget();
  }

  /** A short video of what is done around the moment that is shown. */
  async play() {
    const { wishes, moment } = this;
    this.filming = true;
    this.tell();
    try {
      const video = await this.#followed(async () => (await this.#ask("film", { moment: String(moment) })).blob());
      if (wishes === this.wishes && moment === this.moment) this.video = video;
    } finally {
      this.filming = false;
      this.tell();
    }
  }

  small = () => this.show(SMALL, true);

  firstPicture() {
    return this.#fetch("before", SMALL, { later: "1" });
  }

  /** @param {number} moment */
  goTo(moment) {
    this.moment = moment;
    this.video = null;
    this.#clear();
    const small = this.smalls[moment];
    if (small) this.pictures.before = { blob: small, longest: SMALL }; // until the larger one is there
  }

  /** @param {string} name @param {string} value */
  set(name, value) {
    super.set(name, value);
    this.video = null; // which shows what was asked for before
    if (SEARCHED.includes(name)) {
      this.readout = null;
      this.#cancelled = false;
      this.stop();
    }
    if (!PART.includes(name)) return;
    this.smalls = []; // the moments are others now
    this.#clear();
  }

  /** Whether a person asked for anything that has not been saved. */
  get unsaved() {
    return !WRONG.includes(this.state) && !this.kept && Object.keys(this.options).length > 0;
  }

  /** All as it was when it came. */
  reset() {
    for (const name of Object.keys(this.options)) this.set(name, "");
  }

  #clear() {
    this.pictures = {};
    this.result = this.glimpse = null; // which is of another moment
  }

  async asked() {
    return this.options;
  }

  /** @param {string} what @param {Options} more */
  #ask(what, more = {}) {
    return this.askFor(what, async () => (what === "progress" ? {} : { ...this.options, ...more }), this.#work.signal);
  }

  async #drawSmall() {
    const smalls = this.smalls;
    if (smalls === this.#drawing) return;
    this.#drawing = smalls;
    for (const moment of (this.facts?.moments_s ?? []).keys()) {
      const asked = this.#ask("before", { moment: String(moment), longest: String(SMALL) });
      const blob = await asked.then((answer) => answer.blob()).catch(() => null);
      if (!blob || smalls !== this.smalls) return;
      smalls[moment] = blob;
      this.tell();
    }
  }
}

/** @param {unknown} error */
function unlessRefused(error) {
  if (!(error instanceof Refused)) throw error;
}
