// A photo on the page: its file, what the user said of it, and what the program made of it.

/** @import { Advised, Candidate, Line, Longest, Options, PhotoFacts, PhotoResult, Which } from "./types.js" */

import { factsIn, Refused } from "./api.js";
import { ofGroups } from "./form.js";
import { Opened } from "./opened.js";

const SMALL = 320;
const UNDOING = [...ofGroups("photo", ["undo", "save"]), "candidate"]; // the others find
const WITH_NEIGHBOURS = ["edges", "reference", "readout", "focal-px", ...ofGroups("photo", ["save"])];

const UNTOUCHED = "[{},[],{},{},[]]"; // wishes

/** @typedef {{ sentence: string, advice: Advised[] }} Trouble */

/** Whether an option counts for a photo with neighbours. @param {string} name */
export const goesWithNeighbours = (name) => WITH_NEIGHBOURS.includes(name);

export class Photo extends Opened {
  kind = /** @type {const} */ ("photo");
  /** @type {PhotoFacts | null} */
  facts = null;
  /** @type {PhotoResult | null} */
  result = null;
  /** @type {Line[]} drawn by hand, in shares of width and height */
  lines = [];
  /** @type {Options} numbers set by hand */
  hand = {};
  /** @type {Candidate[]} motions that fit, as the program lists them, each with a small picture */
  candidates = [];
  /** @type {string | null} the options that they were found with, as text */
  #candidatesOf = null;
  #steps = ["[[],{},null]"]; // lines, numbers by hand and candidate, as text, after each step by hand
  #at = 0; // the number of steps that count: the others were taken back
  /** @type {Trouble | null} why the neighbours cannot be used: the photo alone counts then */
  trouble = null;
  /** @type {Partial<Record<Which, Photo>>} taken just then */
  neighbours = {};
  /** @type {Photo[]} that look like a burst, this one among them, in the order in which they were taken */
  burst = [];
  /** @type {Options} that are for a photo with neighbours alone */
  beside = {};

  /** @param {File} file */
  constructor(file) {
    super(file, "/api/photos");
  }

  /**
   * Brings the pictures before and after to the wanted size; tells "change" on the way.
   * @param {Longest} longest @param {boolean} [later] @param {"both" | "after"} part
   */
  async show(longest, later, part = "both") {
    try {
      await this.send();
      if (part === "both") this.become("look");
      const before = part === "both" ? this.#fetch("before", longest, later) : null;
      await Promise.all([before, this.#fetchAfter(longest, later)]);
      const listed = !later && (await this.#listCandidates()); // before it is done: the picture must not move later
      this.become("answer");
      if (listed) this.#drawCandidates();
    } catch (error) {
      this.fail(error);
    }
  }

  /**
   * Changes an option; another way to find the motion finds other candidates.
   * @param {string} name @param {string} value
   */
  set(name, value) {
    super.set(name, value);
    if (name === "min-confidence" || !UNDOING.includes(name)) delete this.options.candidate;
  }

  /** Takes a candidate, counted from 1, whatever was asked for before. @param {number} number */
  take(number) {
    this.resetHand();
    this.set("min-confidence", "");
    if (this.options.strength === "0") this.set("strength", "");
    if (!this.candidates[number - 1].taken) this.set("candidate", String(number));
  }

  /** The number of the candidate that counts, from 1; 0: none of them. */
  get candidate() {
    if (this.byHand || this.between || this.options["min-confidence"] === "0") return 0;
    if (this.options.strength === "0") return 1 + this.candidates.findIndex(({ kind }) => kind === "still");
    return Number(this.options.candidate ?? 1 + this.candidates.findIndex(({ taken }) => taken));
  }

  /** Whether a person chose to leave the photo as it is. */
  get tookStill() {
    return "candidate" in this.options && this.candidates[this.candidate - 1]?.kind === "still";
  }

  /** Whether a person leaves it alone, as a setting or by taking it as it is. */
  get leftAlone() {
    return this.options.strength === "0" || this.tookStill;
  }

  /** Whether lines or numbers by hand say how the camera moved. */
  get byHand() {
    return this.lines.length > 0 || Object.keys(this.hand).length > 0;
  }

  /** Whether the neighbours do. */
  get between() {
    return this.hasNeighbours && !this.trouble && !this.byHand && this.options.strength !== "0";
  }

  get hasNeighbours() {
    return Object.keys(this.neighbours).length > 0;
  }

  /** Why each line stays askew, as far as the answer is about these lines. */
  get lineTroubles() {
    const troubles = this.result?.lines ?? [];
    return troubles.length === this.lines.length ? troubles : [];
  }

  get wishes() {
    const neighbours = Object.entries(this.neighbours).map(([which, { name }]) => [which, name]);
    return JSON.stringify([this.options, this.lines, this.hand, this.beside, neighbours]);
  }

  /** Whether a person asked for anything: what was only looked at need not be saved. */
  get unsaved() {
    return this.state === "done" && Boolean(this.result?.changed) && !this.kept && this.wishes !== UNTOUCHED;
  }

  /** Each photo of its burst takes those before and after it as neighbours. */
  useBurst() {
    this.burst.forEach((photo, k) => {
      for (const neighbour of Object.values(photo.neighbours)) neighbour.forget();
      const sides = Object.entries({ before: this.burst[k - 1], after: this.burst[k + 1] });
      const there = sides.filter(([, other]) => other).map(([which, { file }]) => [which, new Photo(file)]);
      Object.assign(photo, { neighbours: Object.fromEntries(there), beside: {} });
      photo.resetHand();
      if (photo !== this) photo.become("change");
    });
  }

  /**
   * Changes an option for neighbours; the readout ratio is that of the whole burst.
   * @param {string} name @param {string} value
   */
  setBeside(name, value) {
    const others = name === "readout-ratio" ? this.burst.filter((each) => each !== this && each.hasNeighbours) : [];
    for (const { beside } of [this, ...others]) {
      if (value === "") delete beside[name];
      else beside[name] = value;
    }
    for (const photo of others) photo.become("change");
  }

  resetHand() {
    this.lines = [];
    this.hand = {};
  }

  /** All as it was when it came. */
  reset() {
    for (const neighbour of Object.values(this.neighbours)) neighbour.forget();
    Object.assign(this, { options: {}, neighbours: {}, beside: {} });
    this.resetHand();
  }

  /** Leaves the photo as it is, or no more. @param {boolean} alone */
  leave(alone) {
    if (!alone && this.tookStill) delete this.options.candidate;
    this.set("strength", alone ? "0" : "");
  }

  get #step() {
    return JSON.stringify([this.lines, this.hand, this.options.candidate ?? null]);
  }

  /** Remembers what was done by hand, to be undone. */
  remember() {
    if (this.#step !== this.#steps[this.#at]) this.#steps.splice(++this.#at, Infinity, this.#step);
  }

  /** Whether there is a step to undo. */
  get undoable() {
    return this.#at > 0 || this.#step !== this.#steps[0];
  }

  /** Whether there is one to do again. */
  get redoable() {
    return this.#at < this.#steps.length - 1 && this.#step === this.#steps[this.#at];
  }

  /** Takes back the last step by hand, or does the next one again. @param {-1 | 1} by */
  goBy(by) {
    this.remember();
    const step = this.#steps[this.#at + by];
    if (step === undefined) return;
    this.#at += by;
    const [lines, hand, candidate] = JSON.parse(step);
    Object.assign(this, { lines, hand });
    super.set("candidate", candidate ?? "");
  }

  /**
   * The options as they are asked for: what does not go with neighbours is left out where they count, and the reverse.
   */
  async asked() {
    if (!this.between) {
      const { edges, ...others } = this.options;
      const own = edges === undefined || edges === "borrow" ? others : this.options;
      return { ...own, ...this.hand, ...(this.lines.length ? { lines: this.#linesAsText() } : {}) };
    }
    const counts = (/** @type {string} */ name) =>
      goesWithNeighbours(name) && !(name === "reference" && "at" in this.beside); // both say the moment
    const kept = Object.entries(this.options).filter(([name]) => counts(name));
    const ids = Object.entries(this.neighbours).map(async ([which, photo]) => [which, await photo.send()]);
    return { ...Object.fromEntries([...kept, ...(await Promise.all(ids))]), ...this.beside };
  }

  small = () => this.show(SMALL, true);

  firstPicture() {
    return this.#fetch("before", SMALL, true);
  }

  /** A quick picture of what something that is being dragged does. @param {number} longest */
  async draft(longest) {
    return (await this.ask("after", { longest: String(longest), draft: "1" })).blob();
  }

  /**
   * The answer to a question about this photo.
   * @param {string} what @param {Options} more @returns {Promise<Response>}
   */
  ask(what, more = {}) {
    return this.askFor(what, async () => ({ ...(what === "before" ? {} : await this.asked()), ...more }));
  }

  /** Asks what else the motion could be; whether there is something new to draw. */
  async #listCandidates() {
    const options = this.#finding;
    const key = JSON.stringify(options);
    if (this.between || this.#candidatesOf === key) return false;
    this.#candidatesOf = key;
    try {
      this.candidates = await (await this.askFor("candidates", async () => options)).json();
      return true;
    } catch (error) {
      return this.#forgetCandidates(error);
    }
  }

  /** Asks for small pictures of the candidates, as long as nothing else is asked for. */
  async #drawCandidates() {
    const [key, options] = [this.#candidatesOf, this.#finding];
    try {
      for (const [index, candidate] of this.candidates.entries()) {
        const asked = { ...options, candidate: String(index + 1), longest: String(SMALL), later: "1" };
        const answer = await this.askFor("after", async () => asked);
        if (this.#candidatesOf !== key) return;
        candidate.crop = factsIn(answer).crop;
        candidate.blob = await answer.blob();
        this.tell();
      }
    } catch (error) {
      this.#forgetCandidates(error);
    }
  }

  /** They are asked for again with the next answer. @param {unknown} error */
  #forgetCandidates(error) {
    if (!(error instanceof Refused)) throw error;
    this.#candidatesOf = null;
    return false;
  }

  /** The options by which its motion is found. @returns {Options} */
  get #finding() {
    return Object.fromEntries(Object.entries(this.options).filter(([name]) => !UNDOING.includes(name)));
  }

  #linesAsText() {
    const short = (/** @type {number} */ share) => Number(share.toFixed(5));
    return JSON.stringify(this.lines.map(({ kind, points }) => [kind, ...points.flat().map(short)]));
  }

  /**
   * The rectified photo: without its neighbours where they cannot be used.
   * @param {Longest} longest @param {boolean} [later]
   */
  async #fetchAfter(longest, later) {
    this.trouble = null;
    try {
      await this.#fetch("after", longest, later);
      const { changed = true, reason = "", advice = [] } = this.result ?? {};
      if (!this.between || changed || !advice.includes("adviceNeighbours")) return;
      this.trouble = { sentence: reason, advice };
    } catch (error) {
      if (!(error instanceof Refused) || error.status === 404 || !this.between) throw error;
      this.trouble = { sentence: error.message, advice: error.advice };
    }
    await this.#fetch("after", longest, later);
  }

  /** @param {Which} which @param {Longest} longest @param {boolean} [later] */
  async #fetch(which, longest, later) {
    const answer = await this.ask(which, { longest: String(longest), ...(later ? { later: "1" } : {}) });
    const blob = await answer.blob();
    this.pictures[which] = { blob, longest };
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
