// Before and after, one over the other, with a divider to drag; zoom by wheel, pinch and keys; lines over both.
// Where the result is cropped, both are shown in the frame of the crop.

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

const WHOLE = [0, 0, 1, 1];
const GRID_CELLS = 12; // across and down
const STEP = 2; // of the divider, per cent
const MOST_ZOOM = 16; // times the size that fits
const ZOOM_STEP = 1.25; // for a press of a key
const WHEEL = 0.0015; // of the zoom's logarithm for each pixel of the wheel
const [PINCHED_WHEEL, MOST_PINCHED] = [0.01, 20]; // as touch pads send a pinch; a wheel with Ctrl sends more at once

export class Stage {
  #position = 50;
  #size = null; // of the photo [px]
  #crop = WHOLE; // what of it is shown unless a tool is used: left, top, right, bottom, shares
  #mode = ""; // of the tool: "drawing" on the photo as it was taken, "pulling" at the result; "": none
  #zoom = 1; // times the size that fits
  #shift = [0, 0]; // of the frame's middle from the stage's [CSS px]
  #addresses = {};
  #film = null;
  #pointers = new Map();

  // stage: where to; on: {zoom} called when another size of the pictures may be needed.
  constructor(stage, on) {
    this.stage = stage;
    this.on = on;
    this.tool = null; // that takes a press on the picture in its mode: function of the event, returns whether it did
    this.images = { before: make("img", { draggable: "false" }), after: make("img", { draggable: "false" }) };
    this.lines = { before: overlay("lines before"), after: overlay("lines after") };
    this.handle = make(
      "div",
      {
        class: "handle",
        role: "slider",
        tabindex: "0",
        "aria-label": words.slider,
        "aria-valuemin": "0",
        "aria-valuemax": "100",
        "aria-orientation": "horizontal",
      },
      make("span", { "aria-hidden": "true" }, "‹ ›"),
    );
    const tags = ["before", "after"].map((side) =>
      make("span", { class: `tag ${side}`, "aria-hidden": "true" }, words[side]),
    );
    this.wholes = ["after", "before"].map((side) =>
      make("div", { class: "whole" }, this.images[side], this.lines[side]),
    );
    this.frame = make(
      "div",
      { class: "compare" },
      make("div", { class: "layer after" }, this.wholes[0]),
      make("div", { class: "layer before" }, this.wholes[1]),
      ...tags,
      grid(),
      this.handle,
    );
    this.message = make("div", { class: "message", role: "alert", hidden: true });
    stage.replaceChildren(this.frame, this.message);
    this.handle.addEventListener("keydown", (event) => this.#key(event));
    stage.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    stage.addEventListener("pointerdown", (event) => this.#press(event));
    stage.addEventListener("pointermove", (event) => this.#pinch(event));
    for (const name of ["pointerup", "pointercancel"])
      stage.addEventListener(name, (event) => this.#pointers.delete(event.pointerId));
    stage.addEventListener(
      "dblclick",
      (event) =>
        !this.mode && !event.target.closest("button, .handle") && this.toggleZoom([event.clientX, event.clientY]),
    );
    new ResizeObserver(() => this.#fit()).observe(stage);
    this.move(50);
  }

  // ---- what is shown ----

  // Shows one of the pictures, of a photo of that size [px].
  picture(which, blob, size, alt) {
    this.#size = size;
    this.frame.hidden = false;
    this.say("");
    const old = this.#addresses[which];
    this.#addresses[which] = URL.createObjectURL(blob);
    this.images[which].src = this.#addresses[which];
    this.images[which].alt = alt;
    if (old) URL.revokeObjectURL(old);
    this.#fit();
  }

  clear() {
    this.frame.hidden = true;
    for (const image of Object.values(this.images)) image.removeAttribute("src");
    this.say("");
    this.crop(null);
    this.film(null);
    this.segments(null);
    this.whole();
  }

  // Words where the picture would be; "": none.
  say(line) {
    this.message.textContent = line;
    this.message.hidden = !line;
    if (line) this.frame.hidden = true;
  }

  // Whether there is but one picture to show: then there is nothing to divide.
  set single(single) {
    this.frame.classList.toggle("single", single);
  }

  // Whether the picture before covers the one after.
  set original(shown) {
    this.frame.classList.toggle("original", shown);
  }

  // Moving pictures over both: {before, after} canvases; null: none.
  film(halves) {
    if (halves === this.#film) return;
    this.#film = halves;
    for (const [which, image] of Object.entries(this.images)) {
      image.parentNode.querySelector("canvas")?.remove();
      if (halves) image.after(halves[which]);
    }
  }

  // What is left of the picture after: [left, top, right, bottom], shares; null: all.
  crop(window) {
    this.#crop = window ?? WHOLE;
    this.#fit();
  }

  // A tool is used: "drawing", "pulling" or none, "".
  set mode(mode) {
    this.#mode = mode;
    for (const each of ["drawing", "pulling"]) this.frame.classList.toggle(each, each === mode);
    this.#fit();
  }

  get mode() {
    return this.#mode;
  }

  // Shears the picture after by a matrix about a point, until its next picture comes; null: not.
  shear(matrix, origin = "") {
    Object.assign(this.images.after.style, {
      transform: matrix ? `matrix(${matrix}, 0, 0)` : "",
      transformOrigin: origin,
    });
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

  // Straight lines over both pictures to compare with, on or off; whether they are on now.
  toggleGrid() {
    return this.frame.classList.toggle("with-grid");
  }

  // Where all of the photo is on the screen, although a crop may hide some of it.
  get box() {
    return this.wholes[1].getBoundingClientRect();
  }

  // Of an event: shares of the photo's width and height.
  shares(event) {
    const { box } = this;
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  // ---- zoom ----

  get zoomed() {
    return Math.abs(this.#zoom - 1) > 0.001;
  }

  // Pixels of the screen for each pixel of the photo, along a side; 0: there is no photo.
  get scale() {
    return this.#size ? devicePixelRatio * this.#fitting() * this.#zoom : 0;
  }

  // One pixel of the photo for each pixel of the screen; again: all of it.
  toggleZoom(at = null) {
    if (this.zoomed) this.whole();
    else this.zoomTo(1, at);
  }

  zoomTo(scale, at = null) {
    this.zoomBy(scale / this.scale, at);
  }

  whole() {
    this.#zoom = 1;
    this.#shift = [0, 0];
    this.#fit();
  }

  // Zooms about a point of the screen; by default the middle of the stage.
  zoomBy(factor, at = null) {
    if (!this.#size) return;
    const least = Math.min(1, 1 / (devicePixelRatio * this.#fitting())); // small photos are enlarged where they fit
    const zoom = Math.min(Math.max(this.#zoom * factor, least), MOST_ZOOM / Math.min(this.#fitting(), 1));
    const box = this.stage.getBoundingClientRect();
    const from = at ? [at[0] - box.left - box.width / 2, at[1] - box.top - box.height / 2] : [0, 0];
    this.#shift = this.#shift.map((shift, k) => from[k] - ((from[k] - shift) * zoom) / this.#zoom);
    this.#zoom = zoom;
    this.#fit();
  }

  zoomIn = () => this.zoomBy(ZOOM_STEP);
  zoomOut = () => this.zoomBy(1 / ZOOM_STEP);

  // Longer side that a picture takes on the screen [device px].
  get longest() {
    const [width, height] = this.#size
      ? [this.#size.width, this.#size.height].map((side) => side * this.#fitting() * this.#zoom)
      : [this.stage.clientWidth, this.stage.clientHeight];
    return Math.max(width, height) * devicePixelRatio;
  }

  get #window() {
    return this.#mode ? WHOLE : this.#crop;
  }

  // Width and height of what is shown of the photo [px].
  get #shownSize() {
    const [left, top, right, bottom] = this.#window;
    return [this.#size.width * (right - left), this.#size.height * (bottom - top)];
  }

  // CSS px for each pixel of the photo where all of it is shown.
  #fitting() {
    const [width, height] = this.#shownSize;
    return Math.min(this.stage.clientWidth / width, this.stage.clientHeight / height);
  }

  #fit() {
    if (!this.#size || !this.stage.clientWidth) return;
    const [across, down] = this.#shownSize;
    document.documentElement.style.setProperty("--aspect", across / down); // a phone leaves no more room than that takes
    const sides = [across, down].map((side) => side * this.#fitting() * this.#zoom);
    const room = [this.stage.clientWidth, this.stage.clientHeight];
    this.#shift = this.#shift.map((shift, k) => {
      const most = Math.max((sides[k] - room[k]) / 2, 0);
      return Math.min(Math.max(shift, -most), most);
    });
    const [left, top] = room.map((side, k) => (side - sides[k]) / 2 + this.#shift[k]);
    Object.assign(this.frame.style, {
      width: `${sides[0]}px`,
      height: `${sides[1]}px`,
      left: `${left}px`,
      top: `${top}px`,
    });
    const [x1, y1, x2, y2] = this.#window;
    for (const [name, value] of Object.entries({
      left: -x1 / (x2 - x1),
      top: -y1 / (y2 - y1),
      width: 1 / (x2 - x1),
      height: 1 / (y2 - y1),
    })) {
      for (const whole of this.wholes) whole.style[name] = `${100 * value}%`;
    }
    this.stage.classList.toggle("zoomed", this.zoomed);
    this.on.zoom();
  }

  // ---- what the user does ----

  #key(event) {
    const moves = { ArrowLeft: -STEP, ArrowRight: STEP, PageDown: -5 * STEP, PageUp: 5 * STEP, Home: -100, End: 100 };
    if (!(event.key in moves)) return;
    event.preventDefault();
    this.move(this.#position + moves[event.key]);
  }

  #wheel(event) {
    if (this.frame.hidden) return;
    event.preventDefault();
    const pinched = PINCHED_WHEEL * Math.min(Math.max(event.deltaY, -MOST_PINCHED), MOST_PINCHED);
    this.zoomBy(Math.exp(-(event.ctrlKey ? pinched : WHEEL * event.deltaY)), [event.clientX, event.clientY]);
  }

  #press(event) {
    if (event.button !== 0 || this.frame.hidden || event.target.closest("button")) return;
    this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.#pointers.size > 1) return;
    event.preventDefault();
    const grabbed = event.target.closest(".handle");
    if (grabbed) this.handle.focus({ focusVisible: false });
    else if (this.mode && this.tool(event)) return;
    if (this.zoomed && !grabbed)
      return this.drag(event, (dx, dy) => {
        this.#shift = [this.#shift[0] + dx, this.#shift[1] + dy];
        this.#fit();
      });
    if (!event.target.closest(".compare") || this.frame.classList.contains("single")) return;
    const follow = (at) => {
      const box = this.frame.getBoundingClientRect();
      this.move((100 * (at.clientX - box.left)) / box.width);
    };
    if (!grabbed) follow(event);
    this.drag(event, (_dx, _dy, at) => follow(at));
  }

  // Two fingers: zooms by how their distance changes, and goes with their middle.
  #pinch(event) {
    if (!this.#pointers.has(event.pointerId)) return;
    if (this.#pointers.size === 2) {
      const apart = ([[x1, y1], [x2, y2]]) => Math.hypot(x1 - x2, y1 - y2);
      const middle = ([[x1, y1], [x2, y2]]) => [(x1 + x2) / 2, (y1 + y2) / 2];
      const before = [...this.#pointers.values()];
      this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
      const now = [...this.#pointers.values()];
      const [from, to] = [middle(before), middle(now)];
      this.#shift = this.#shift.map((shift, k) => shift + to[k] - from[k]);
      this.zoomBy(apart(now) / Math.max(apart(before), 1), to);
    } else this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  // Follows a press: moved(dx, dy, event) hears of each step, ended(event) of its end.
  drag(start, moved, ended = () => {}) {
    let { clientX: x, clientY: y } = start;
    const target = this.stage;
    target.setPointerCapture(start.pointerId);
    const go = (event) => {
      if (event.pointerId !== start.pointerId || this.#pointers.size > 1) return;
      moved(event.clientX - x, event.clientY - y, event);
      ({ clientX: x, clientY: y } = event);
    };
    const stop = (event) => {
      if (event.pointerId !== start.pointerId) return;
      target.removeEventListener("pointermove", go);
      target.removeEventListener("pointerup", stop);
      target.removeEventListener("pointercancel", stop);
      ended(event);
    };
    target.addEventListener("pointermove", go);
    target.addEventListener("pointerup", stop);
    target.addEventListener("pointercancel", stop);
  }
}

function grid() {
  const at = [...Array(GRID_CELLS - 1).keys()].map((k) => (k + 1) / GRID_CELLS);
  const node = overlay("grid");
  node.append(
    ...at.flatMap((x) => [draw("line", { x1: x, x2: x, y1: 0, y2: 1 }), draw("line", { x1: 0, x2: 1, y1: x, y2: x })]),
  );
  return node;
}

export function overlay(kind) {
  return draw("svg", { class: kind, viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" });
}
