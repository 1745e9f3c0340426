// A clip on the page: some moments of it are looked at, before and after, and then the whole of it is saved.

import { factsIn, Refused } from "./api.js";
import { Opened } from "./opened.js";
import { films } from "./options.js";
import { pace } from "./saving.js";
import { words } from "./words.js";

const SMALL = 320;
const PART = ["start", "end"]; // options that say which part of the clip is kept
const SEARCHED = [...PART, "readout-ms", "readout-ratio", "camera"]; // options that the search for the readout time goes by
const LOOK_MS = 500; // between looks at how far it is

export const isClip = (file) => file.type.startsWith("video/") || films.some((ending) => file.name.toLowerCase().endsWith(ending));

export class Clip extends Opened {
  kind = "clip";
  moment = 2; // which of the five is shown: the middle one
  smalls = []; // small pictures of all moments
  film = null; // before and after, moving
  filming = false; // whether that is being made
  readout = null; // what is known of the camera's readout time
  doing = { share: 0, left: "" }; // how far the search for it is, or the film, and how long that still takes
  #drawing = null; // the small pictures that are on their way
  #work = new AbortController(); // of what the program does now
  #cancelled = false;

  constructor(file) {
    super(file, "/api/clips");
  }

  // Brings the pictures of the moment to the wanted size: the frame at once, a first look with the usual readout time, and
  // what the clip's own gives. In the background no motion is looked for: that takes long.
  async show(longest, later, part = "both") {
    const [pictures, moment] = [this.pictures, this.moment];
    const fetch = async (which, more = later ? { later: 1 } : {}) => {
      const answer = await this.#ask(which, { moment, longest, ...more });
      pictures[which] = { blob: await answer.blob(), longest };
      if (pictures === this.pictures) this[which === "before" ? "facts" : "result"] = factsIn(answer);
      this.tell();
    };
    try {
      await this.send();
      this.become("finding");
      if (part === "both") await fetch("before");
      if (!later) this.#drawSmall(); // the frames are there long before their motion is
    } catch (error) {
      return this.fail(error);
    }
    if (later) return this.become("opened");
    try {
      if (this.#cancelled) throw new Refused(0, words.stopped);
      if (!this.readout) {
        await fetch("after", { usual: 1 }).catch((error) => this.#unlessRefused(error)); // the search says what is wrong
        this.readout = await this.#followed("readout time", async () => (await this.#ask("readout")).json());
      }
      await fetch("after");
      this.become("done");
    } catch (error) {
      const failure = this.#cancelled ? new Refused(0, words.stopped) : error;
      if (failure instanceof Refused) this.readout = this.result = this.pictures.after = null;
      this.fail(failure, "asking"); // the clip can be read: it is the settings that do not do
    }
  }

  #unlessRefused(error) {
    if (!(error instanceof Refused)) throw error;
  }

  // The answer to a question that takes long; until it comes, looks how far it is.
  async #followed(goal, asked) {
    const tell = pace(goal);
    const look = async () => {
      this.doing = tell(await (await this.#ask("progress")).json());
      this.tell();
    };
    this.doing = tell(null);
    const looking = setInterval(() => look().catch(() => {}), LOOK_MS); // it may end meanwhile
    try {
      return await asked();
    } finally {
      clearInterval(looking);
    }
  }

  // Stops what the program does for the clip.
  stop() {
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

  // A short film of what is done around the moment that is shown.
  async play() {
    const { wishes, moment } = this;
    this.filming = true;
    this.tell();
    try {
      const film = await this.#followed("film", async () => (await this.#ask("film", { moment })).blob());
      if (wishes === this.wishes && moment === this.moment) this.film = film;
    } finally {
      this.filming = false;
      this.tell();
    }
  }

  small = (later) => this.show(SMALL, later);

  goTo(moment) {
    this.moment = moment;
    this.film = null;
    this.#clear();
    if (this.smalls[moment]) this.pictures.before = { blob: this.smalls[moment], longest: SMALL }; // until the larger one is there
  }

  set(name, value) {
    super.set(name, value);
    this.film = null; // which shows what was asked for before
    if (SEARCHED.includes(name)) {
      this.readout = null;
      this.#cancelled = false;
      this.stop();
    }
    if (!PART.includes(name)) return;
    this.smalls = []; // the moments are others now
    this.#clear();
  }

  #clear() {
    this.pictures = {};
    this.result = null;
  }

  async asked() {
    return this.options;
  }

  #ask(what, more = {}) {
    return this.askFor(what, async () => (what === "progress" ? {} : { ...this.options, ...more }), this.#work.signal);
  }

  async #drawSmall() {
    const smalls = this.smalls;
    if (smalls === this.#drawing) return;
    this.#drawing = smalls;
    for (const moment of this.facts.moments_s.keys()) {
      const blob = await this.#ask("before", { moment, longest: SMALL })
        .then((answer) => answer.blob())
        .catch(() => null);
      if (!blob || smalls !== this.smalls) return;
      smalls[moment] = blob;
      this.tell();
    }
  }
}
