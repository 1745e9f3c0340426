// Before and after, one over the other, with a divider to drag; zoom by wheel, pinch and keys; lines over both.
// Where the result is cropped, both are shown in the frame of the crop.

/** @import { Arrow, Box, Point, Segments, Which } from "./types.js" */

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

/** @type {Box} */
const WHOLE = [0, 0, 1, 1];
/** Directions on the screen. @type {Record<Arrow, Point>} */
export const VECTORS = { down: [0, 1], up: [0, -1], right: [1, 0], left: [-1, 0] };
const SIDES = /** @type {const} */ (["before", "after"]);
const GRID_CELLS = 12; // across and down
/** Keys -> how far the divider goes [%]. @type {Record<string, number>} */
const MOVES = {
  ArrowLeft: -2,
  ArrowRight: 2,
  ArrowDown: -2,
  ArrowUp: 2,
  PageDown: -10,
  PageUp: 10,
  Home: -100,
  End: 100,
};
const MOST_ZOOM = 16; // times the size that fits
const ZOOM_STEP = 1.25; // for a press of a key
const WHEEL = 0.0015; // of the zoom's logarithm for each pixel of the wheel
const [PINCHED_WHEEL, MOST_PINCHED] = [0.01, 20]; // as touch pads send a pinch; a wheel with Ctrl sends more at once

/** @typedef {"drawing" | "pulling" | ""} Mode on the photo as it was taken, at the result; "": no tool is used */
/** @typedef {Record<Which, HTMLCanvasElement>} Halves */
/** @typedef {{ width: number, height: number }} Size [px] */

/** What a press is on. @param {Event} event @param {string} selector */
export const pressed = ({ target }, selector) => /** @type {Element} */ (target).closest(selector);
/** @param {MouseEvent} event @returns {Point} */
const placeOf = ({ clientX, clientY }) => [clientX, clientY];
/** @param {number} value @param {number} least @param {number} most */
export const within = (value, least, most) => Math.min(Math.max(value, least), most);

export class Stage {
  #position = 50;
  /** @type {Size | null} of the photo */
  #size = null;
  #crop = WHOLE; // what of it is shown unless a tool is used
  /** @type {Mode} */
  #mode = "";
  #zoom = 1; // times the size that fits
  /** @type {Point} of the frame's middle from the stage's [CSS px] */
  #shift = [0, 0];
  /** @type {Halves | null} */
  #video = null;
  /** @type {Map<number, Point>} */
  #pointers = new Map();
  /** @type {(event: PointerEvent) => boolean} takes a press on the picture in the tool's mode; whether it did */
  tool = () => false;

  /** @param {HTMLElement} stage where to @param {() => void} zoomChanged called when other pictures may be needed */
  constructor(stage, zoomChanged) {
    this.stage = stage;
    this.zoomChanged = zoomChanged;
    this.images = { before: make("img", { draggable: "false" }), after: make("img", { draggable: "false" }) };
    this.lines = { before: overlay("lines before"), after: overlay("lines after") };
    const whole = (/** @type {Which} */ side) => make("div.whole", this.images[side], this.lines[side]);
    this.wholes = { before: whole("before"), after: whole("after") };
    const range = { "aria-valuemin": "0", "aria-valuemax": "100", "aria-orientation": "horizontal" };
    const slider = { role: "slider", tabindex: "0", "aria-label": words.slider, ...range };
    this.handle = make("div.handle", slider, make("span", { "aria-hidden": "true" }, "‹ ›"));
    const layers = [make("div.layer.after", this.wholes.after), make("div.layer.before", this.wholes.before)];
    const tags = SIDES.map((side) => make(`span.tag.${side}`, { "aria-hidden": "true" }, words[side]));
    this.frame = make("div.compare", ...layers, ...tags, grid(), this.handle);
    this.message = make("div.message", { role: "alert", hidden: true });
    stage.replaceChildren(this.frame, this.message);
    this.handle.addEventListener("keydown", (event) => this.#key(event));
    stage.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    stage.addEventListener("pointerdown", (event) => this.#press(event));
    stage.addEventListener("pointermove", (event) => this.#pinch(event));
    stage.addEventListener("pointerup", (event) => this.#pointers.delete(event.pointerId));
    stage.addEventListener("pointercancel", (event) => this.#pointers.delete(event.pointerId));
    stage.addEventListener("dblclick", (event) => {
      if (!this.mode && !pressed(event, "button, .handle")) this.toggleZoom(placeOf(event));
    });
    new ResizeObserver(() => this.#fit()).observe(stage);
    this.move(50);
  }

  // ---- what is shown ----

  /**
   * Shows one of the pictures, of a photo of that size.
   * @param {Which} which @param {Blob} blob @param {Size} size @param {string} alt
   */
  picture(which, blob, size, alt) {
    this.#size = size;
    this.frame.hidden = false;
    this.say("");
    const [image, old] = [this.images[which], this.images[which].src];
    image.src = URL.createObjectURL(blob);
    image.alt = alt;
    URL.revokeObjectURL(old);
    this.#fit();
  }

  clear() {
    this.frame.hidden = true;
    for (const image of Object.values(this.images)) {
      URL.revokeObjectURL(image.src);
      image.removeAttribute("src");
    }
    this.say("");
    this.crop(null);
    this.video(null);
    this.segments(null);
    this.whole();
  }

  /** Words where the picture would be; "": none. @param {string} line */
  say(line) {
    this.message.textContent = line;
    this.message.hidden = !line;
    if (line) this.frame.hidden = true;
  }

  /** Whether there is but one picture to show: then there is nothing to divide. @param {boolean} single */
  set single(single) {
    this.frame.classList.toggle("single", single);
  }

  /** Whether the picture before covers the one after. @param {boolean} shown */
  set original(shown) {
    this.frame.classList.toggle("original", shown);
  }

  /** Moving pictures over both; null: none. @param {Halves | null} halves */
  video(halves) {
    if (halves === this.#video) return;
    this.#video = halves;
    for (const side of SIDES) {
      this.wholes[side].querySelector("canvas")?.remove();
      if (halves) this.images[side].after(halves[side]);
    }
  }

  /** What is left of the picture after; null: all. @param {Box | null} window */
  crop(window) {
    this.#crop = window ?? WHOLE;
    this.#fit();
  }

  /** A tool is used, or none. @param {Mode} mode */
  set mode(mode) {
    this.#mode = mode;
    for (const each of ["drawing", "pulling"]) this.frame.classList.toggle(each, each === mode);
    this.#fit();
  }

  get mode() {
    return this.#mode;
  }

  /**
   * Shears the picture after by a matrix about a point, until its next picture comes; null: not.
   * @param {number[] | null} matrix
   */
  shear(matrix, origin = "") {
    const transform = matrix ? `matrix(${matrix}, 0, 0)` : "";
    Object.assign(this.images.after.style, { transform, transformOrigin: origin });
  }

  /** Lines over both pictures; null: none. @param {Segments | null} both */
  segments(both) {
    for (const side of SIDES) {
      const drawn = (both?.[side] ?? []).map(([x1, y1, x2, y2]) => draw("line", { x1, y1, x2, y2 }));
      this.lines[side].replaceChildren(...drawn);
    }
  }

  /** Moves the divider. @param {number} position from the left, per cent */
  move(position) {
    this.#position = within(position, 0, 100);
    this.frame.style.setProperty("--position", `${this.#position}%`);
    this.handle.setAttribute("aria-valuenow", String(Math.round(this.#position)));
  }

  /** Straight lines over both pictures to compare with, on or off; whether they are on now. */
  toggleGrid() {
    return this.frame.classList.toggle("with-grid");
  }

  /** Where all of the photo is on the screen, although a crop may hide some of it. */
  get box() {
    return this.wholes.before.getBoundingClientRect();
  }

  /** Of an event: shares of the photo's width and height. @param {MouseEvent} event @returns {Point} */
  shares(event) {
    const { box } = this;
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  // ---- zoom ----

  get zoomed() {
    return Math.abs(this.#zoom - 1) > 0.001;
  }

  /** Pixels of the screen for each pixel of the photo, along a side; 0: there is no photo. */
  get scale() {
    return this.#size ? devicePixelRatio * this.#fitting * this.#zoom : 0;
  }

  /** One pixel of the photo for each pixel of the screen; again: all of it. @param {Point} [at] */
  toggleZoom(at) {
    if (this.zoomed) this.whole();
    else this.zoomTo(1, at);
  }

  /** @param {number} scale @param {Point} [at] */
  zoomTo(scale, at) {
    this.zoomBy(scale / this.scale, at);
  }

  whole() {
    this.#zoom = 1;
    this.#shift = [0, 0];
    this.#fit();
  }

  /**
   * Zooms about a point of the screen; by default the middle of the stage.
   * @param {number} factor @param {Point} [at]
   */
  zoomBy(factor, at) {
    if (!this.#size) return;
    const least = Math.min(1, 1 / (devicePixelRatio * this.#fitting)); // small photos are enlarged where they fit
    const zoom = within(this.#zoom * factor, least, MOST_ZOOM / Math.min(this.#fitting, 1));
    const { left, top, width, height } = this.stage.getBoundingClientRect();
    const [x, y] = at ? [at[0] - left - width / 2, at[1] - top - height / 2] : [0, 0];
    const [dx, dy] = this.#shift;
    this.#shift = [x - ((x - dx) * zoom) / this.#zoom, y - ((y - dy) * zoom) / this.#zoom];
    this.#zoom = zoom;
    this.#fit();
  }

  zoomIn = () => this.zoomBy(ZOOM_STEP);
  zoomOut = () => this.zoomBy(1 / ZOOM_STEP);

  /** Longer side that a picture takes on the screen [device px]. */
  get longest() {
    const { clientWidth, clientHeight } = this.stage;
    const { width, height } = this.#size ?? { width: clientWidth, height: clientHeight };
    return Math.max(width, height) * (this.#size ? this.scale : devicePixelRatio);
  }

  get #window() {
    return this.#mode ? WHOLE : this.#crop;
  }

  /** Width and height of what is shown of the photo [px]. @returns {Point} */
  get #shownSize() {
    const [left, top, right, bottom] = this.#window;
    const { width, height } = this.#size ?? { width: 1, height: 1 };
    return [width * (right - left), height * (bottom - top)];
  }

  /** CSS px for each pixel of the photo where all of it is shown. */
  get #fitting() {
    const [width, height] = this.#shownSize;
    return Math.min(this.stage.clientWidth / width, this.stage.clientHeight / height);
  }

  #fit() {
    if (!this.#size || !this.stage.clientWidth) return;
    const [across, down] = this.#shownSize;
    document.documentElement.style.setProperty("--aspect", String(across / down)); // a phone leaves it no more room
    const [width, height] = [across, down].map((side) => side * this.#fitting * this.#zoom);
    const { clientWidth, clientHeight } = this.stage;
    const kept = (/** @type {number} */ shift, /** @type {number} */ over) => within(shift, -over / 2, over / 2);
    const [dx, dy] = this.#shift;
    this.#shift = [kept(dx, Math.max(width - clientWidth, 0)), kept(dy, Math.max(height - clientHeight, 0))];
    const [left, top] = [(clientWidth - width) / 2 + this.#shift[0], (clientHeight - height) / 2 + this.#shift[1]];
    place(this.frame, [left, top, width, height], 1, "px");
    const [x1, y1, x2, y2] = this.#window;
    const part = [-x1 / (x2 - x1), -y1 / (y2 - y1), 1 / (x2 - x1), 1 / (y2 - y1)];
    for (const whole of Object.values(this.wholes)) place(whole, part, 100, "%");
    this.stage.classList.toggle("zoomed", this.zoomed);
    this.zoomChanged();
  }

  // ---- what the user does ----

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (!(event.key in MOVES)) return;
    event.preventDefault();
    this.move(this.#position + MOVES[event.key]);
  }

  /** @param {WheelEvent} event */
  #wheel(event) {
    if (this.frame.hidden) return;
    event.preventDefault();
    const pinched = PINCHED_WHEEL * within(event.deltaY, -MOST_PINCHED, MOST_PINCHED);
    this.zoomBy(Math.exp(-(event.ctrlKey ? pinched : WHEEL * event.deltaY)), placeOf(event));
  }

  /** @param {PointerEvent} event */
  #press(event) {
    if (event.button !== 0 || this.frame.hidden || pressed(event, "button")) return;
    this.#pointers.set(event.pointerId, placeOf(event));
    if (this.#pointers.size > 1) return;
    event.preventDefault();
    const grabbed = pressed(event, ".handle");
    if (grabbed) this.handle.focus({ focusVisible: false });
    else if (this.mode && this.tool(event)) return;
    if (this.zoomed && !grabbed) return this.drag(event, (dx, dy) => this.shiftBy(dx, dy));
    if (!pressed(event, ".compare") || this.frame.classList.contains("single")) return;
    const follow = (/** @type {PointerEvent} */ at) => {
      const box = this.frame.getBoundingClientRect();
      this.move((100 * (at.clientX - box.left)) / box.width);
    };
    if (!grabbed) follow(event);
    this.drag(event, (_dx, _dy, at) => follow(at));
  }

  /** Moves a picture that is zoomed in [CSS px]. @param {number} dx @param {number} dy */
  shiftBy(dx, dy) {
    this.#shift = [this.#shift[0] + dx, this.#shift[1] + dy];
    this.#fit();
  }

  /** Two fingers: zooms by how their distance changes, and goes with their middle. @param {PointerEvent} event */
  #pinch(event) {
    if (!this.#pointers.has(event.pointerId)) return;
    const before = [...this.#pointers.values()];
    this.#pointers.set(event.pointerId, placeOf(event));
    if (before.length !== 2) return;
    const now = [...this.#pointers.values()];
    const [from, to] = [middle(before[0], before[1]), middle(now[0], now[1])];
    this.#shift = [this.#shift[0] + to[0] - from[0], this.#shift[1] + to[1] - from[1]];
    this.zoomBy(apart(now[0], now[1]) / Math.max(apart(before[0], before[1]), 1), to);
  }

  /**
   * Follows a press: moved hears of each step, ended of its end.
   * @param {PointerEvent} start @param {(dx: number, dy: number, event: PointerEvent) => void} moved
   * @param {(event: PointerEvent) => void} [ended]
   */
  drag(start, moved, ended = () => {}) {
    let [x, y] = placeOf(start);
    const target = this.stage;
    const until = new AbortController();
    target.setPointerCapture(start.pointerId);
    const go = (/** @type {PointerEvent} */ event) => {
      if (event.pointerId !== start.pointerId || this.#pointers.size > 1) return;
      moved(event.clientX - x, event.clientY - y, event);
      [x, y] = placeOf(event);
    };
    const stop = (/** @type {PointerEvent} */ event) => {
      if (event.pointerId !== start.pointerId) return;
      until.abort();
      ended(event);
    };
    target.addEventListener("pointermove", go, until);
    target.addEventListener("pointerup", stop, until);
    target.addEventListener("pointercancel", stop, until);
  }
}

/**
 * @param {HTMLElement} node @param {number[]} box left, top, width, height @param {number} times @param {string} unit
 */
function place({ style }, box, times, unit) {
  const [left, top, width, height] = box.map((side) => `${times * side}${unit}`);
  Object.assign(style, { left, top, width, height });
}

/** @param {Point} one @param {Point} other */
export const apart = ([x1, y1], [x2, y2]) => Math.hypot(x1 - x2, y1 - y2);
/** @param {Point} one @param {Point} other @returns {Point} */
export const middle = ([x1, y1], [x2, y2]) => [(x1 + x2) / 2, (y1 + y2) / 2];

function grid() {
  const at = [...Array(GRID_CELLS - 1).keys()].map((k) => (k + 1) / GRID_CELLS);
  const down = at.map((x) => draw("line", { x1: x, x2: x, y1: 0, y2: 1 }));
  const across = at.map((y) => draw("line", { x1: 0, x2: 1, y1: y, y2: y }));
  const node = overlay("grid");
  node.append(...down, ...across);
  return node;
}

/** @param {string} kind */
export function overlay(kind) {
  return draw("svg", { class: kind, viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" });
}
