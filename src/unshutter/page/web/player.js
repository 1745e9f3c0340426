// A few seconds of a clip before and after, in step: one film has both halves of each frame, two canvases show them.

import { make } from "./nodes.js";
import { words } from "./words.js";

export class Player {
  #film = null; // that the clip has for its options as they are
  #address = "";
  #halves;

  // node: where its controls go; stage: shows both halves; on: {play} called when a film is asked for.
  constructor(node, stage, on) {
    this.stage = stage;
    this.video = make("video", { muted: true, loop: true, playsinline: true });
    this.video.muted = true;
    this.#halves = {
      before: make("canvas", { "aria-hidden": "true" }),
      after: make("canvas", { "aria-hidden": "true" }),
    };
    this.button = make(
      "button",
      { type: "button", id: "play", onclick: () => (this.#film ? this.toggle() : on.play()) },
      words.play,
    );
    this.place = make("input", {
      type: "range",
      id: "play-at",
      min: "0",
      max: "1",
      step: "any",
      "aria-label": words.playAt,
      hidden: true,
    });
    this.place.addEventListener("input", () => {
      this.video.pause();
      this.video.currentTime = this.place.value * (this.video.duration || 0);
    });
    this.bar = make("progress", { "aria-label": words.progress });
    this.said = make("span", { role: "status" });
    this.left = make("span", { class: "quiet" });
    this.cancel = make(
      "button",
      { type: "button", id: "clip-cancel", onclick: () => this.clip.cancel() },
      words.cancel,
    );
    node.replaceChildren(this.button, this.place, this.bar, this.cancel, this.said, this.left);
    for (const name of ["play", "pause", "ended"]) this.video.addEventListener(name, () => this.#label());
    for (const name of ["loadeddata", "seeked"]) this.video.addEventListener(name, () => this.#draw());
    this.node = node;
  }

  // Shows the controls of a clip, and how far its motion or film is; of a photo, none. The film is gone once the clip has
  // another, or none.
  show(clip) {
    this.clip = clip;
    this.node.hidden = clip.kind !== "clip" || !["finding", "done"].includes(clip.state);
    const busy = clip.state === "finding" || clip.filming;
    this.said.textContent = !busy ? "" : clip.filming ? words.filming : words.searching;
    this.left.textContent = busy ? (clip.doing?.left ?? "") : "";
    this.bar.hidden = !busy;
    this.cancel.hidden = !busy || !clip.facts; // × closes it before
    if (clip.doing?.share) this.bar.value = clip.doing.share;
    else this.bar.removeAttribute("value");
    this.button.hidden = Boolean(busy);
    if (clip.film !== this.#film) this.#load(clip.film ?? null);
  }

  toggle() {
    if (this.video.paused) this.video.play().catch(() => {});
    else this.video.pause();
  }

  #load(film) {
    this.#film = film;
    if (this.#address) URL.revokeObjectURL(this.#address);
    this.#address = film ? URL.createObjectURL(film) : "";
    this.video.pause();
    this.place.hidden = !film;
    this.stage.film(null);
    if (film) {
      this.video.src = this.#address;
      this.video.play().catch(() => {});
    } else this.video.removeAttribute("src");
    this.#label();
  }

  #label() {
    const playing = this.#film && !this.video.paused;
    this.button.textContent = playing ? words.pause : words.play;
    this.button.setAttribute("aria-pressed", Boolean(playing));
    if (playing) this.#follow();
  }

  // Draws each frame as it is shown.
  #follow() {
    const next = () => {
      if (this.video.paused || !this.#film) return;
      this.#draw();
      this.place.value = this.video.currentTime / (this.video.duration || 1);
      this.#each(next);
    };
    this.#each(next);
  }

  #each = (drawn) =>
    this.video.requestVideoFrameCallback ? this.video.requestVideoFrameCallback(drawn) : requestAnimationFrame(drawn);

  #draw() {
    const [width, height] = [this.video.videoWidth / 2, this.video.videoHeight];
    if (!this.#film || !width) return;
    for (const [k, canvas] of [this.#halves.before, this.#halves.after].entries()) {
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
      canvas.getContext("2d").drawImage(this.video, k * width, 0, width, height, 0, 0, width, height);
    }
    this.stage.film(this.#halves);
  }
}
