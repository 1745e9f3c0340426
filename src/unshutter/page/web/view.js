// The photo or clip that is looked at: its pictures, panel and advice on the screen, asked for anew as options change.

/** @import { Item, Longest, Notice, Segments, Which } from "./types.js" */

import { Advice } from "./advice.js";
import { isAbort } from "./api.js";
import { Bar } from "./bar.js";
import { Candidates } from "./candidates.js";
import { ClipControls } from "./clip_controls.js";
import { Controls } from "./controls.js";
import { Lines } from "./lines.js";
import { Moments } from "./moments.js";
import { element } from "./nodes.js";
import { Player } from "./player.js";
import { messageOf, saveMotion, saveOne } from "./saving.js";
import { Stage } from "./stage.js";
import { WRONG } from "./states.js";
import { stateSaid } from "./strip.js";
import { words } from "./words.js";

const SIDES = [1000, 1600, 2400]; // longer sides of copies for screens [px], as the program makes them
const ZOOM_REST_MS = 250;
const SLOW_MS = 300; // an answer that takes longer is announced

/** @param {Longest} one @param {Longest} other */
const larger = (one, other) => other !== "full" && (one === "full" || one > other);

/** @typedef {{ notice: Notice, toAll(): void, step(by: number): void, close(): void }} On */

export class View {
  /** @type {Item | null} */
  current = null;
  /** @type {Partial<Record<Which, Blob | null>>} that are on the stage */
  #shown = {};
  #resizing = 0;
  #drafting = false;
  #draftAgain = false;
  /** @type {Item | null} that is asked for */
  #asking = null;
  /** @type {"both" | "after" | null} what was asked for meanwhile: only the last wish counts */
  #again = null;
  #linesShown = false;

  /** @param {On} on */
  constructor(on) {
    this.on = on;
    this.stage = new Stage(element("stage"), () => this.#zoomed());
    this.bar = new Bar(element("bar"), this.stage, { ...on, fullScreen: () => this.fullScreen() });
    this.lines = new Lines(
      this.stage,
      () => this.refresh(),
      () => this.draft(),
    );
    this.controls = new Controls(element("panel"), this.lines, this);
    this.clipControls = new ClipControls(element("clip-panel"), this);
    const { hand, neighbours } = this.controls;
    this.advice = new Advice(element("advice"), {
      adviceWay: (way) => this.#change("moving", way),
      adviceLevel: () => this.#change("upright", "level"),
      adviceAnyway: () => this.#change("min-confidence", "0"),
      adviceNeighbour: () => neighbours.open(),
      adviceNeighbours: () => neighbours.open(),
      adviceLeaveNeighbours: () => neighbours.clear(),
      adviceByHand: () => hand.open(),
      useBurst: () => this.#useBurst(),
      toolDone: () => hand.stop(),
    });
    this.moments = new Moments(element("moments"), (number) => this.goTo(number));
    this.player = new Player(element("player"), this.stage, () => this.#video());
    this.candidates = new Candidates(element("candidates"), (number) => this.take(number));
  }

  /** What is looked at, if it is a photo. */
  get photo() {
    return this.current?.kind === "photo" ? this.current : null;
  }

  /** What is looked at, if it is a clip. */
  get clip() {
    return this.current?.kind === "clip" ? this.current : null;
  }

  get panel() {
    return this.clip ? this.clipControls : this.controls;
  }

  /** Shows another photo or clip; null: none. @param {Item | null} item */
  show(item) {
    this.current = item;
    if (!item) return;
    this.#shown = {};
    this.stage.clear();
    this.#linesShown = false;
    this.controls.hand.stop();
    this.bar.show(item.name);
    this.update();
    this.refresh("both");
  }

  #showPanel() {
    if (this.photo) this.controls.show(this.photo);
    else if (this.clip) this.clipControls.show(this.clip);
  }

  /** What is known of the current photo or clip goes to the screen. */
  update() {
    const item = this.current;
    if (!item) return;
    const { pictures, result, state, kind, error } = item;
    this.#showPictures(item);
    this.stage.crop(result?.crop ?? null);
    const both = kind === "clip" ? pictures.after : result?.changed && ["done", "finding"].includes(state);
    this.stage.single = !both;
    this.#showPanel();
    this.#advise();
    this.moments.show(item);
    this.player.show(item);
    this.candidates.show(item);
    const inPicture = WRONG.includes(state) && !pictures.before; // the error is said where the picture would be
    const failed = state === "failed";
    if (inPicture) this.stage.say([words.sentence(error, item.name), failed ? words.failedHelp : ""].join(" "));
    element("viewer").classList.toggle("bare", inPicture && failed);
    element("panel").hidden = kind !== "photo" || failed;
    element("clip-panel").hidden = kind !== "clip";
    const saidElsewhere = ["done", "asking"].includes(state) || inPicture;
    const reading = kind === "clip" && state === "finding" && (pictures.before || item.glimpse ? "" : words.opening);
    element("working").textContent = saidElsewhere
      ? ""
      : failed
        ? error
        : reading !== false
          ? reading
          : stateSaid(item);
    element("working").classList.toggle("wrong", failed && !inPicture);
  }

  /** @param {Item} item */
  #showPictures({ pictures, facts, name, glimpse }) {
    const alts = { before: words.beforeAlt(name), after: words.afterAlt(name) };
    for (const which of /** @type {const} */ (["before", "after"])) {
      const first = which === "before" && !pictures.before ? glimpse : null;
      const [blob, size] = [(first ?? pictures[which])?.blob, first ?? facts];
      if (!blob || !size || this.#shown[which] === blob) continue;
      this.#shown[which] = blob;
      this.stage.picture(which, blob, size, alts[which]);
      if (which === "before" && !pictures.after) this.stage.picture("after", blob, size, "");
    }
  }

  /**
   * Asks for the current photo as its options are now; while an answer is on its way, only the last wish counts.
   * @param {"both" | "after"} [part]
   */
  async refresh(part) {
    const item = this.current;
    if (!item) return;
    this.photo?.remember();
    this.#showPanel();
    if (this.#asking === item) {
      this.#again = this.#again === "both" ? "both" : (part ?? "after");
      return;
    }
    this.#asking = item;
    const size = this.#longest();
    const whole = part === "both" || item.pictures.before?.longest !== size;
    if (size === "full") element("working").textContent = words.drawing;
    const slow = setTimeout(() => {
      if (item === this.photo) element("working").textContent ||= words.working;
    }, SLOW_MS);
    await item.show(size, false, whole ? "both" : "after");
    clearTimeout(slow);
    if (this.#asking === item) this.#asking = null;
    if (item !== this.current) return;
    if (this.#linesShown) this.#showLines();
    if (this.#again) {
      const next = this.#again;
      this.#again = null;
      this.refresh(next);
    }
  }

  toAll() {
    this.on.toAll();
  }

  saveMotion() {
    if (this.photo) saveMotion(this.photo, this.on.notice);
  }

  save() {
    if (this.current && !this.panel.save.disabled) saveOne(this.current, this.on.notice);
  }

  /** Another moment of a clip, from 0. @param {number} number */
  goTo(number) {
    if (!this.clip || number >= (this.clip.facts?.moments_s.length ?? 0)) return;
    this.clip.goTo(number);
    this.refresh("both");
  }

  /** Another motion of a photo, from 1. @param {number} number */
  take(number) {
    if (!this.photo?.candidates[number - 1]) return;
    this.photo.take(number);
    this.refresh();
  }

  /** Takes back the last step by hand, or does the next one again. @param {-1 | 1} by */
  goBy(by) {
    this.photo?.goBy(by);
    if (this.photo) this.refresh();
  }

  /** What a number on the keyboard picks, from 1. @param {number} number */
  pick(number) {
    if (this.clip) this.goTo(number - 1);
    else this.candidates.pickShown(number - 1);
  }

  /** Plays a clip, or stops it. */
  play() {
    if (this.clip?.state === "done") this.player.button.click();
  }

  async #video() {
    const { clip } = this;
    try {
      await clip?.play();
    } catch (error) {
      if (clip && !isAbort(error)) this.on.notice(words.error(clip.name, messageOf(error)));
    }
  }

  toggleLines() {
    if (this.clip) return;
    this.#linesShown = !this.#linesShown;
    if (this.#linesShown) this.#showLines();
    else this.stage.segments(null);
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else
      element("viewer")
        .requestFullscreen?.()
        .catch(() => {});
  }

  #longest() {
    const { longest, zoomed } = this.stage;
    return SIDES.find((side) => side >= longest) ?? (zoomed ? "full" : SIDES[SIDES.length - 1]);
  }

  /** Another zoom: once it rests, pictures of that size are asked for. */
  #zoomed() {
    this.bar.zoomed();
    clearTimeout(this.#resizing);
    this.#resizing = setTimeout(() => {
      const before = this.current?.pictures.before;
      if (before && larger(this.#longest(), before.longest)) this.refresh("both");
    }, ZOOM_REST_MS);
  }

  /** What something that is being dragged does: quick pictures, one after the other, the last one as it rests. */
  async draft() {
    const { photo } = this;
    this.#draftAgain = true;
    if (this.#drafting || !photo) return;
    this.#drafting = true;
    while (this.#draftAgain && photo === this.photo) {
      this.#draftAgain = false;
      const after = photo.pictures.after;
      const blob = await photo.draft(SIDES[0]).catch(() => null); // the whole answer says what is wrong
      if (!blob || !photo.facts || photo !== this.photo || photo.pictures.after !== after) continue;
      this.stage.single = false;
      this.stage.picture("after", blob, photo.facts, words.afterAlt(photo.name));
      this.#shown.after = null; // the whole answer is to take its place
    }
    this.#drafting = false;
  }

  /** @param {string} name @param {string} value */
  #change(name, value) {
    this.current?.set(name, value);
    this.refresh();
  }

  #useBurst() {
    this.photo?.useBurst();
    this.refresh();
    this.controls.neighbours.showTiming();
  }

  #advise() {
    if (this.current) this.advice.show(this.current, this.controls.hand.tool);
  }

  /** A tool by hand is taken or put away: lines are drawn on the photo as it was taken, and snap to its segments. */
  async using() {
    this.#advise();
    if (!this.photo || this.lines.kind === null) return;
    const found = await this.#segments(this.photo).catch(() => null); // lines are drawn as well without
    this.lines.segments = found?.before ?? [];
  }

  async #showLines() {
    const { photo } = this;
    if (!photo) return;
    try {
      const segments = await this.#segments(photo);
      if (photo === this.photo && this.#linesShown) this.stage.segments(segments);
    } catch (error) {
      this.on.notice(words.error(photo.name, messageOf(error)));
    }
  }

  /** @param {NonNullable<View["photo"]>} photo @returns {Promise<Segments>} */
  async #segments(photo) {
    return (await photo.ask("segments")).json();
  }
}
