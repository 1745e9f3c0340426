// A clip on the page: some moments of it are looked at, before and after, and then the whole of it is saved.

import { factsIn } from "./api.js";
import { Opened } from "./opened.js";

const ENDINGS = /\.(3g2|3gp|avi|lrv|m2ts|m4v|mkv|mov|mp4|mpe?g|mts|mxf|ts|webm|wmv)$/i;
const SMALL = 320;
const PART = ["start", "end"]; // options that say which part of the clip is kept

export const isClip = (file) => file.type.startsWith("video/") || ENDINGS.test(file.name);

export class Clip extends Opened {
  kind = "clip";
  moment = 2; // which of the five is shown: the middle one
  smalls = []; // small pictures of all moments
  film = null; // before and after, moving
  filming = false; // whether that is being made
  readout = null; // what is known of the camera's readout time
  #drawing = null; // the small pictures that are on their way

  constructor(file) {
    super(file, "/api/clips");
  }

  // Brings the pictures of the moment to the wanted size. In the background no motion is looked for: that takes long.
  async show(longest, later, part = "both") {
    const [pictures, moment] = [this.pictures, this.moment];
    const fetch = async (which) => {
      const answer = await this.#ask(which, { moment, longest, ...(later ? { later: 1 } : {}) });
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
      this.readout = await (await this.#ask("readout")).json();
      await fetch("after");
      this.become("done");
    } catch (error) {
      this.readout = null;
      this.fail(error, "asking"); // the clip can be read: it is the settings that do not do
    }
  }

  // A short film of what is done around the moment that is shown.
  async play() {
    const { wishes, moment } = this;
    this.filming = true;
    this.tell();
    try {
      const film = await (await this.#ask("film", { moment })).blob();
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
  }

  set(name, value) {
    super.set(name, value);
    this.film = null; // which shows what was asked for before
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
    return this.askFor(what, async () => ({ ...this.options, ...more }));
  }

  async #drawSmall() {
    const smalls = this.smalls;
    if (smalls === this.#drawing) return;
    this.#drawing = smalls;
    for (const moment of this.facts.moments_s.keys()) {
      const answer = await this.#ask("before", { moment, longest: SMALL, later: 1 }).catch(() => null);
      if (!answer || smalls !== this.smalls) return;
      smalls[moment] = await answer.blob();
      this.tell();
    }
  }
}
