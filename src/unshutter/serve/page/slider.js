// Before and after, one over the other, with a divider to drag; lines over both; zoom to single pixels.

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

const STEP = 2; // per cent

export class Slider {
  #position = 50;
  #size = null; // of the photo [px]
  #zoomed = false;
  #addresses = {};

  constructor(stage) {
    this.stage = stage;
    this.images = { before: make("img", { draggable: "false" }), after: make("img", { draggable: "false" }) };
    this.lines = { before: overlay("before"), after: overlay("after") };
    this.handle = make("div", { class: "handle", role: "slider", tabindex: "0", "aria-label": words.slider,
      "aria-valuemin": "0", "aria-valuemax": "100", "aria-orientation": "horizontal" }, make("span", { "aria-hidden": "true" }, "‹ ›"));
    const tags = ["before", "after"].map((side) => make("span", { class: `tag ${side}`, "aria-hidden": "true" }, words[side]));
    this.frame = make("div", { class: "compare" },
      make("div", { class: "layer after" }, this.images.after, this.lines.after),
      make("div", { class: "layer before" }, this.images.before, this.lines.before), ...tags, this.handle);
    stage.replaceChildren(this.frame);
    this.handle.addEventListener("keydown", (event) => this.#key(event));
    this.frame.addEventListener("pointerdown", (event) => this.#press(event));
    new ResizeObserver(() => this.#fit()).observe(stage);
    this.move(50);
  }

  // Shows one of the pictures, of a photo of that size [px].
  picture(which, blob, size, alt) {
    this.#size = size;
    this.frame.hidden = false;
    if (this.#addresses[which]) URL.revokeObjectURL(this.#addresses[which]);
    this.#addresses[which] = URL.createObjectURL(blob);
    this.images[which].src = this.#addresses[which];
    this.images[which].alt = alt;
    this.#fit();
  }

  clear() {
    this.frame.hidden = true;
    for (const image of Object.values(this.images)) image.removeAttribute("src");
    this.crop(null);
    this.segments(null);
  }

  // What is left of the picture after: [left, top, right, bottom], shares; null: all.
  crop(window) {
    const [left, top, right, bottom] = window ?? [0, 0, 1, 1];
    const inset = [top, 1 - right, 1 - bottom, left].map((share) => `${100 * share}%`).join(" ");
    this.images.after.style.clipPath = `inset(${inset})`;
  }

  // Lines over both pictures: {before: [[x, y, x, y]...], after}, shares; null: none.
  segments(both) {
    for (const [which, svg] of Object.entries(this.lines)) {
      const drawn = (both?.[which] ?? []).map(([x1, y1, x2, y2]) => draw("line", { x1, y1, x2, y2 }));
      svg.replaceChildren(...drawn);
    }
  }

  move(position) {
    this.#position = Math.min(Math.max(position, 0), 100);
    this.frame.style.setProperty("--position", `${this.#position}%`);
    this.handle.setAttribute("aria-valuenow", Math.round(this.#position));
  }

  get zoomed() {
    return this.#zoomed;
  }

  set zoomed(value) {
    this.#zoomed = value;
    this.stage.classList.toggle("zoomed", value);
    this.#fit();
    if (value) {
      this.stage.scrollLeft = (this.frame.offsetWidth - this.stage.clientWidth) / 2;
      this.stage.scrollTop = (this.frame.offsetHeight - this.stage.clientHeight) / 2;
    }
  }

  // Longer side of what a picture may take on the screen [device px].
  get longest() {
    return Math.max(this.stage.clientWidth, this.stage.clientHeight) * devicePixelRatio;
  }

  #fit() {
    if (!this.#size) return;
    const { width, height } = this.#size;
    const fitting = Math.min(this.stage.clientWidth / width, this.stage.clientHeight / height);
    const scale = this.#zoomed ? 1 / devicePixelRatio : fitting;
    this.frame.style.width = `${width * scale}px`;
    this.frame.style.height = `${height * scale}px`;
  }

  #key(event) {
    const moves = { ArrowLeft: -STEP, ArrowRight: STEP, PageDown: -5 * STEP, PageUp: 5 * STEP, Home: -100, End: 100 };
    if (!(event.key in moves)) return;
    event.preventDefault();
    this.move(this.#position + moves[event.key]);
  }

  #press(event) {
    if (event.button !== 0 || event.target.closest(".end")) return;
    event.preventDefault();
    const grabbed = event.target.closest(".handle");
    if (grabbed) this.handle.focus();
    if (this.#zoomed && !grabbed) return this.#drag(event, (dx, dy) => this.stage.scrollBy(-dx, -dy));
    const box = this.frame.getBoundingClientRect();
    const follow = (at) => this.move((100 * (at.clientX - box.left)) / box.width);
    if (!grabbed) follow(event);
    this.#drag(event, (dx, dy, at) => follow(at));
  }

  #drag(start, moved) {
    let { clientX: x, clientY: y } = start;
    const target = this.frame;
    target.setPointerCapture(start.pointerId);
    const go = (event) => {
      moved(event.clientX - x, event.clientY - y, event);
      ({ clientX: x, clientY: y } = event);
    };
    const stop = () => {
      target.removeEventListener("pointermove", go);
      target.removeEventListener("pointerup", stop);
      target.removeEventListener("pointercancel", stop);
    };
    target.addEventListener("pointermove", go);
    target.addEventListener("pointerup", stop);
    target.addEventListener("pointercancel", stop);
  }
}

function overlay(which) {
  return draw("svg", { class: `lines ${which}`, viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" });
}
