// A few seconds of a clip before and after, in step: one video has both halves of each frame, two canvases show them.

/** @import { Clip } from "./clip.js" @import { Item } from "./types.js" @import { Stage } from "./stage.js" */

import { make } from "./nodes.js";
import { AT_WORK } from "./states.js";
import { button } from "./widgets.js";
import { words } from "./words.js";

export class Player {
  /** @type {Blob | null} that the clip has for its options as they are */
  #video = null;
  /** @type {Clip | null} */
  #clip = null;
  #halves = { before: make("canvas", { "aria-hidden": "true" }), after: make("canvas", { "aria-hidden": "true" }) };

  /**
   * @param {HTMLElement} node where its controls go @param {Stage} stage shows both halves
   * @param {() => void} play called when a video is asked for
   */
  constructor(node, stage, play) {
    this.stage = stage;
    this.video = make("video", { muted: true, loop: true, playsinline: true });
    this.video.muted = true;
    this.button = button("play", () => (this.#video ? this.toggle() : play()));
    const range = { type: "range", id: "play-at", min: "0", max: "1", step: "any" };
    this.place = make("input", range, { "aria-label": words.playAt, hidden: true, oninput: () => this.#seek() });
    this.bar = make("progress", { "aria-label": words.progress });
    this.said = make("span", { role: "status" });
    this.left = make("span.quiet");
    this.cancel = button("stopSearch", () => this.#clip?.cancel());
    node.replaceChildren(this.button, this.place, this.bar, this.cancel, this.said, this.left);
    for (const name of ["play", "pause", "ended"]) this.video.addEventListener(name, () => this.#label());
    for (const name of ["loadeddata", "seeked"]) this.video.addEventListener(name, () => this.#draw());
    this.node = node;
  }

  /**
   * Shows the controls of a clip, and how far its motion or video is; of a photo, none. The video is gone once the clip
   * has another, or none.
   * @param {Item} item
   */
  show(item) {
    const clip = item.kind === "clip" ? item : null;
    this.#clip = clip;
    const searching = clip !== null && AT_WORK.includes(clip.state);
    const busy = clip !== null && (searching || clip.filming);
    this.node.hidden = !searching && clip?.state !== "done";
    this.said.textContent = !busy ? "" : clip.filming ? words.filming : clip.facts ? words.searching : words.opening;
    this.left.textContent = busy ? clip.doing.left : "";
    this.bar.hidden = !busy;
    this.cancel.hidden = !busy || !clip.facts; // × closes it before
    if (clip?.doing.share) this.bar.value = clip.doing.share;
    else this.bar.removeAttribute("value");
    this.button.hidden = busy;
    const video = clip?.video ?? null;
    if (video !== this.#video) this.#load(video);
  }

  toggle() {
    if (this.video.paused) this.video.play().catch(() => {});
    else this.video.pause();
  }

  #seek() {
    this.video.pause();
    this.video.currentTime = Number(this.place.value) * (this.video.duration || 0);
  }

  /** @param {Blob | null} video */
  #load(video) {
    this.#video = video;
    URL.revokeObjectURL(this.video.src);
    this.video.pause();
    this.place.hidden = !video;
    this.stage.video(null);
    if (video) {
      this.video.src = URL.createObjectURL(video);
      this.video.play().catch(() => {});
    } else this.video.removeAttribute("src");
    this.#label();
  }

  #label() {
    const playing = this.#video !== null && !this.video.paused;
    this.button.textContent = playing ? words.pause : words.play;
    this.button.setAttribute("aria-pressed", String(playing));
    if (playing) this.#follow();
  }

  /** Draws each frame as it is shown. */
  #follow() {
    const wait = (/** @type {() => void} */ drawn) =>
      "requestVideoFrameCallback" in this.video
        ? this.video.requestVideoFrameCallback(drawn)
        : requestAnimationFrame(drawn);
    const next = () => {
      if (this.video.paused || !this.#video) return;
      this.#draw();
      this.place.value = String(this.video.currentTime / (this.video.duration || 1));
      wait(next);
    };
    wait(next);
  }

  #draw() {
    const [width, height] = [this.video.videoWidth / 2, this.video.videoHeight];
    if (!this.#video || !width) return;
    for (const [k, canvas] of [this.#halves.before, this.#halves.after].entries()) {
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      canvas.getContext("2d")?.drawImage(this.video, k * width, 0, width, height, 0, 0, width, height);
    }
    this.stage.video(this.#halves);
  }
}
