// A photo on the page: its file, what the user said of it, and what the program made of it.

import { factsIn, Refused } from "./api.js";
import { ofGroups } from "./described.js";
import { Opened } from "./opened.js";
import { words } from "./words.js";

const SMALL = 320;
const NEIGHBOURS_FAIL = ["other-size", "scenes-differ", "too-little-to-follow", "frames-disagree", "no-neighbour"];
const UNDOING = ofGroups("photo", ["undo", "save"]); // the others find
const WITH_NEIGHBOURS = ["edges", "reference", "readout", "focal-px", ...ofGroups("photo", ["save"])]; // options that go with them

export class Photo extends Opened {
  kind = "photo";
  lines = []; // drawn by hand: {kind, points: [[x, y], ...]}, shares of width and height
  hand = {}; // numbers set by hand: name of the field -> text
  candidates = []; // motions that fit, as the program lists them, each with a small picture
  #candidatesOf = null; // the options that they were found with
  #steps = ["[[],{},null]"]; // lines, numbers by hand and candidate, as text, after each step by hand
  neighbourCode = ""; // of the reason below, where it has one
  neighbourError = ""; // why the neighbours cannot be used: the photo alone counts then
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
      await Promise.all([part === "both" ? this.#fetch("before", asked) : null, this.#fetchAfter(asked)]);
      const listed = !later && (await this.#listCandidates()); // before it is done: their row must not move the picture later
      this.become("done");
      if (listed) this.#drawCandidates();
    } catch (error) {
      this.fail(error);
    }
  }

  // Changes an option; another way to find the motion finds other candidates.
  set(name, value) {
    super.set(name, value);
    if (name === "min-confidence" || ![...UNDOING, "candidate"].includes(name)) delete this.options.candidate;
  }

  // Takes a candidate, counted from 1, whatever was asked for before.
  take(number) {
    this.resetHand();
    this.set("min-confidence", "");
    if (this.options.strength === "0") this.set("strength", "");
    if (!this.candidates[number - 1].taken) this.set("candidate", number);
  }

  // The number of the candidate that counts, from 1; 0: none of them.
  get candidate() {
    if (this.byHand || this.between || this.options["min-confidence"] === "0") return 0;
    if (this.options.strength === "0") return 1 + this.candidates.findIndex(({ kind }) => kind === "still");
    return Number(this.options.candidate ?? 1 + this.candidates.findIndex(({ taken }) => taken));
  }

  // Whether a person chose to leave the photo as it is.
  get tookStill() {
    return "candidate" in this.options && this.candidates[this.candidate - 1]?.kind === "still";
  }

  // Whether lines or numbers by hand say how the camera moved.
  get byHand() {
    return this.lines.length > 0 || Object.keys(this.hand).length > 0;
  }

  // Why each line stays askew, as far as the answer is about these lines.
  get lineTroubles() {
    return this.result?.lines?.length === this.lines.length ? this.result.lines : [];
  }

  // Whether the neighbours do.
  get between() {
    return (
      Object.keys(this.neighbours).length > 0 && !this.neighbourError && !this.byHand && this.options.strength !== "0"
    );
  }

  // All that was asked for, as text: whether it was saved is known by it.
  get wishes() {
    const neighbours = Object.entries(this.neighbours).map(([which, { name }]) => [which, name]);
    return JSON.stringify([this.options, this.lines, this.hand, this.beside, neighbours]);
  }

  setHand(name, value) {
    this.hand[name] = value;
  }

  resetHand() {
    this.lines = [];
    this.hand = {};
  }

  // Leaves the photo as it is, or no more.
  leave(alone) {
    if (!alone && this.tookStill) delete this.options.candidate;
    this.set("strength", alone ? "0" : "");
  }

  get #step() {
    return JSON.stringify([this.lines, this.hand, this.options.candidate ?? null]);
  }

  // Remembers what was done by hand, to be undone.
  remember() {
    if (this.#step !== this.#steps.at(-1)) this.#steps.push(this.#step);
  }

  // Whether there is a step to undo.
  get undoable() {
    return this.#steps.length > 1 || this.#step !== this.#steps[0];
  }

  // Takes back the last step by hand.
  undo() {
    while (this.#steps.length > 1 && this.#steps.at(-1) === this.#step) this.#steps.pop();
    const [lines, hand, candidate] = JSON.parse(this.#steps.at(-1));
    Object.assign(this, { lines, hand });
    if (candidate === null) delete this.options.candidate;
    else this.options.candidate = candidate;
  }

  // The options as they are asked for: what does not go with neighbours is left out where they count, and the reverse.
  async asked() {
    if (!this.between) {
      const { edges, ...others } = this.options;
      const own = edges === undefined || edges === "borrow" ? others : { ...others, edges };
      return { ...own, ...this.hand, ...(this.lines.length ? { lines: this.#linesAsText() } : {}) };
    }
    const kept = Object.entries(this.options).filter(
      ([name]) => WITH_NEIGHBOURS.includes(name) && !(name === "reference" && "at" in this.beside),
    ); // both say the moment
    const ids = Object.entries(this.neighbours).map(async ([which, photo]) => [which, await photo.sent()]);
    return { ...Object.fromEntries([...kept, ...(await Promise.all(ids))]), ...this.beside };
  }

  small = (later) => this.show(SMALL, later);

  // A quick picture of what something that is being dragged does.
  async draft(longest) {
    return (await this.ask("after", { longest, draft: 1 })).blob();
  }

  // The answer to a question about this photo.
  ask(what, more = {}) {
    return this.askFor(what, async () => ({ ...(what === "before" ? {} : await this.asked()), ...more }));
  }

  // Asks what else the motion could be; whether there is something new to draw.
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

  // Asks for small pictures of the candidates, as long as nothing else is asked for.
  async #drawCandidates() {
    const [key, options] = [this.#candidatesOf, this.#finding];
    try {
      for (const [index, candidate] of this.candidates.entries()) {
        const asked = { ...options, candidate: index + 1, longest: SMALL, later: 1 };
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

  // They are asked for again with the next answer.
  #forgetCandidates(error) {
    if (!(error instanceof Refused)) throw error;
    this.#candidatesOf = null;
    return false;
  }

  // The options by which its motion is found.
  get #finding() {
    return Object.fromEntries(
      Object.entries(this.options).filter(([name]) => ![...UNDOING, "candidate"].includes(name)),
    );
  }

  #linesAsText() {
    return JSON.stringify(
      this.lines.map(({ kind, points }) => [kind, ...points.flat().map((share) => Number(share.toFixed(5)))]),
    );
  }

  // The rectified photo: without its neighbours where they cannot be used.
  async #fetchAfter(asked) {
    this.neighbourError = this.neighbourCode = "";
    try {
      await this.#fetch("after", asked);
      if (!this.between || this.result.changed || !NEIGHBOURS_FAIL.includes(this.result.code)) return;
      this.neighbourError = words.why(this.result);
      await this.#fetch("after", asked);
    } catch (error) {
      if (!(error instanceof Refused) || error.status === 404 || !this.between) throw error;
      [this.neighbourError, this.neighbourCode] = [error.message, error.code];
      await this.#fetch("after", asked);
    }
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
