// The photo or clip that is looked at: its pictures, panel and advice on the screen, asked for anew as options change.

import { Advice } from "./advice.js";
import { Candidates } from "./candidates.js";
import { ClipControls } from "./clip_controls.js";
import { Controls } from "./controls.js";
import { Lines } from "./lines.js";
import { Moments } from "./moments.js";
import { by, nameParts } from "./nodes.js";
import { Player } from "./player.js";
import { saveMotion, saveOne } from "./saving.js";
import { Stage } from "./stage.js";
import { stateOf } from "./strip.js";
import { percent, words } from "./words.js";

const SIDES = [1000, 1600, 2400]; // longer sides of copies for screens [px], as the program makes them
const ZOOM_REST_MS = 250;
const SLOW_MS = 300; // an answer that takes longer is announced

const larger = (one, other) => other !== "full" && (one === "full" || one > other);

export class View {
  current = null;
  #shown = {}; // the blobs that are on the stage
  #resizing = null;
  #drafting = false;
  #draftAgain = false;
  #asking = null; // the photo that is asked for
  #again = null; // what was asked for meanwhile: only the last wish counts
  #linesShown = false;

  // on: {notice(line), toAll} called with what to tell, and when others shall get the options of this one.
  constructor(on) {
    this.on = on;
    this.stage = new Stage(by("stage"), { zoom: () => this.#zoomed() });
    const lines = new Lines(
      this.stage,
      () => {
        this.controls.show(this.current);
        this.refresh();
      },
      () => this.#draft(),
    );
    this.lines = lines;
    const undo = () => this.undo();
    this.controls = new Controls(by("panel"), lines, {
      change: () => this.refresh(),
      draft: () => this.#draft(),
      tool: () => this.#using(),
      undo,
      lines: () => this.toggleLines(),
      save: () => this.save(),
      saveMotion: () => saveMotion(this.current, on.notice),
      toAll: on.toAll,
    });
    this.clipControls = new ClipControls(by("clip-panel"), {
      change: () => this.refresh(this.current.pictures.before ? "after" : "both"),
      save: () => this.save(),
      toAll: on.toAll,
    });
    this.advice = new Advice(by("advice"), {
      moving: (way) => this.#change("moving", way),
      anyway: () => this.#change("min-confidence", "0"),
      neighbour: () => this.controls.neighbours.open(),
      ratio: () => this.controls.neighbours.askRatio(),
      byHand: () => this.controls.hand.open(),
      done: () => this.controls.hand.stop(),
      leaveNeighbours: () => this.controls.neighbours.clear(),
    });
    this.moments = new Moments(by("moments"), (number) => this.goTo(number));
    this.player = new Player(by("player"), this.stage, { play: () => this.#film() });
    this.candidates = new Candidates(by("candidates"), (number) => this.take(number));
  }

  get panel() {
    return this.current.kind === "clip" ? this.clipControls : this.controls;
  }

  // Shows another photo or clip; null: none.
  show(photo) {
    this.current = photo;
    if (!photo) return;
    this.#shown = {};
    this.stage.clear();
    this.#linesShown = false;
    this.controls.hand.stop();
    by("name").replaceChildren(...nameParts(photo.name));
    by("name").title = photo.name;
    this.update();
    this.refresh("both");
  }

  // What is known of the current photo goes to the screen.
  update() {
    const { facts, pictures, result, state, kind } = this.current;
    for (const [which, alt] of [
      ["before", words.beforeAlt],
      ["after", words.afterAlt],
    ]) {
      const picture = pictures[which];
      if (!picture || !facts || this.#shown[which] === picture.blob) continue;
      this.#shown[which] = picture.blob;
      this.stage.picture(which, picture.blob, facts, alt(this.current.name));
      if (which === "before" && !pictures.after) this.stage.picture("after", picture.blob, facts, "");
    }
    this.stage.crop(result?.crop ?? null);
    this.stage.single = kind === "clip" ? !pictures.after : !(result?.changed && ["done", "finding"].includes(state));
    this.panel.show(this.current);
    this.#advise();
    this.moments.show(this.current);
    this.player.show(this.current);
    this.candidates.show(this.current);
    const inPicture = ["failed", "asking"].includes(state) && !pictures.before; // the error is said where the picture would be
    if (inPicture)
      this.stage.say(
        [words.sentence(this.current.error, this.current.name), state === "failed" ? words.failedHelp : ""].join(" "),
      );
    by("viewer").classList.toggle("bare", inPicture && state === "failed");
    by("panel").hidden = kind !== "photo" || state === "failed";
    by("clip-panel").hidden = kind !== "clip";
    const failed = state === "failed" && !inPicture; // what is asked for is said in the panel
    const quiet = ["done", "asking"].includes(state) || inPicture || (kind === "clip" && state === "finding"); // which its bar says
    by("working").textContent = quiet ? "" : failed ? this.current.error : stateOf(this.current);
    by("working").classList.toggle("wrong", failed);
  }

  // Asks for the current photo as its options are now; while an answer is on its way, only the last wish counts.
  async refresh(part) {
    const photo = this.current;
    if (photo.kind === "photo") photo.remember();
    this.panel.show(photo);
    if (this.#asking === photo) {
      this.#again = this.#again === "both" ? "both" : (part ?? "after");
      return;
    }
    this.#asking = photo;
    const size = this.#longest();
    const whole = part === "both" || photo.pictures.before?.longest !== size;
    if (size === "full") by("working").textContent = words.drawing;
    const slow = setTimeout(() => {
      if (photo === this.current && photo.kind === "photo") by("working").textContent ||= words.working;
    }, SLOW_MS);
    await photo.show(size, false, whole ? "both" : "after");
    clearTimeout(slow);
    if (this.#asking === photo) this.#asking = null;
    if (photo !== this.current) return;
    if (this.#linesShown) this.#showLines();
    if (this.#again) {
      const next = this.#again;
      this.#again = null;
      this.refresh(next);
    }
  }

  save() {
    if (!this.panel.save.disabled) saveOne(this.current, this.on.notice);
  }

  // Another moment of a clip, from 0.
  goTo(number) {
    if (number >= (this.current.facts?.moments_s.length ?? 0)) return;
    this.current.goTo(number);
    this.refresh("both");
  }

  // Another motion of a photo, from 1.
  take(number) {
    if (!this.current.candidates[number - 1]) return;
    this.current.take(number);
    this.refresh();
  }

  // Takes back the last step by hand.
  undo() {
    if (this.current.kind === "clip" || !this.current.undoable) return;
    this.current.undo();
    this.refresh();
  }

  // What a number on the keyboard picks, from 1.
  pick(number) {
    if (this.current.kind === "clip") this.goTo(number - 1);
    else this.candidates.pickShown(number - 1);
  }

  // Plays a clip, or stops it.
  play() {
    if (this.current.kind === "clip" && this.current.state === "done") this.player.button.click();
  }

  async #film() {
    const clip = this.current;
    try {
      await clip.play();
    } catch (error) {
      if (error.name !== "AbortError") this.on.notice(words.error(clip.name, error.message));
    }
  }

  original(on) {
    this.stage.original = on;
  }

  toggleLines() {
    if (this.current.kind === "clip") return;
    this.#linesShown = !this.#linesShown;
    if (this.#linesShown) this.#showLines();
    else this.stage.segments(null);
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else
      by("viewer")
        .requestFullscreen?.()
        .catch(() => {});
  }

  #longest() {
    const { longest, zoomed } = this.stage;
    return SIDES.find((side) => side >= longest) ?? (zoomed ? "full" : SIDES[SIDES.length - 1]);
  }

  // Another zoom: once it rests, pictures of that size are asked for.
  #zoomed() {
    by("zoom").options[0].textContent = percent(this.stage.scale);
    clearTimeout(this.#resizing);
    this.#resizing = setTimeout(() => {
      const before = this.current?.pictures.before;
      if (before && larger(this.#longest(), before.longest)) this.refresh("both");
    }, ZOOM_REST_MS);
  }

  // What something that is being dragged does: quick pictures, one after the other, the last one as it rests.
  async #draft() {
    this.#draftAgain = true;
    if (this.#drafting) return;
    this.#drafting = true;
    const photo = this.current;
    while (this.#draftAgain && photo === this.current) {
      this.#draftAgain = false;
      const after = photo.pictures.after;
      try {
        const blob = await photo.draft(SIDES[0]);
        if (photo !== this.current || photo.pictures.after !== after) continue;
        this.stage.single = false;
        this.stage.picture("after", blob, photo.facts, words.afterAlt(photo.name));
        this.#shown.after = null; // the whole answer is to take its place
      } catch {
        // the whole answer says what is wrong
      }
    }
    this.#drafting = false;
  }

  #change(name, value) {
    this.current.set(name, value);
    this.refresh();
  }

  #advise() {
    this.advice.show(this.current, this.controls.hand.tool);
  }

  // A tool by hand is taken or put away: lines are drawn on the photo as it was taken, and snap to its segments.
  async #using() {
    const photo = this.current;
    this.#advise();
    if (!photo || this.lines.kind === null) return;
    try {
      this.lines.segments = (await (await photo.ask("segments")).json()).before;
    } catch {
      this.lines.segments = []; // lines are drawn as well without
    }
  }

  async #showLines() {
    const photo = this.current;
    try {
      const segments = await (await photo.ask("segments")).json();
      if (photo === this.current && this.#linesShown) this.stage.segments(segments);
    } catch (error) {
      this.on.notice(words.error(photo.name, error.message));
    }
  }
}
