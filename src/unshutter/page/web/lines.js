// Lines that the user draws along things in the photo before it is straightened: upright, level, or bent though
// straight.

/** @import { Arrow, Line, LineKind, LineTrouble, Point, Segment } from "./types.js" */
/** @import { Stage } from "./stage.js" */

import { draw, make } from "./nodes.js";
import { apart, middle, overlay, VECTORS, within } from "./stage.js";
import { words } from "./words.js";

const STEP = 0.002; // share of the picture for a press of an arrow key
const SHORTEST = 0.03; // share of the picture: shorter drags draw nothing
const LARGER = 3; // times, in the loupe
const REACH = 10; // CSS px within which an end snaps to a segment
const SLOPE = Math.sin((6 * Math.PI) / 180); // between a line and a segment that it snaps to
/** A line in the middle. @type {Record<LineKind, Point[]>} */
const IN_THE_MIDDLE = {
  upright: [
    [0.5, 0.25],
    [0.5, 0.75],
  ],
  level: [
    [0.25, 0.5],
    [0.75, 0.5],
  ],
  straight: [
    [0.5, 0.25],
    [0.5, 0.5],
    [0.5, 0.75],
  ],
};
export const KINDS = /** @type {LineKind[]} */ (Object.keys(IN_THE_MIDDLE));

/** @typedef {{ kind: LineKind, number: number, end: number, point: Point }} End */

export class Lines {
  /** @type {LineKind | null} */
  #kind = null;
  /** @type {Line[]} */
  #list = [];
  /** @type {Segment[]} that ends snap to, in shares */
  segments = [];
  /** @type {(LineTrouble | null)[]} */
  #troubles = [];

  /**
   * @param {Stage} stage on which they are drawn
   * @param {() => void} changed called when a line was drawn, moved or removed
   * @param {() => void} moving while one is moved
   */
  constructor(stage, changed, moving) {
    this.stage = stage;
    this.changed = changed;
    this.moving = moving;
    this.svg = overlay("drawn");
    this.handles = make("div.ends");
    this.loupe = make("div.loupe", { hidden: true, "aria-hidden": "true" });
    stage.frame.append(this.svg, this.handles, this.loupe);
  }

  /**
   * Shows a photo's lines, which it changes, and the trouble with each.
   * @param {Line[]} list @param {(LineTrouble | null)[]} troubles
   */
  show(list, troubles = []) {
    this.#list = list;
    this.#troubles = troubles;
    this.#draw();
  }

  /** What the next drag on the picture draws; null: nothing, and no line can be changed. */
  get kind() {
    return this.#kind;
  }

  set kind(kind) {
    this.#kind = kind;
    this.stage.mode = kind === null ? "" : "drawing";
    this.stage.tool = (event) => this.#begin(event);
    this.#draw();
  }

  /** A line in the middle, to be moved by its ends: for those who use the keyboard. @param {LineKind} kind */
  add(kind) {
    this.#list.push({ kind, points: structuredClone(IN_THE_MIDDLE[kind]) });
    this.#draw();
    document.getElementById(idOf({ number: this.#list.length - 1, end: 0 }))?.focus();
    this.changed();
  }

  /** @param {number} number */
  remove(number) {
    this.#list.splice(number, 1);
    this.#draw();
    this.changed();
  }

  /** @param {PointerEvent} event */
  #begin(event) {
    const kind = this.#kind;
    const start = this.stage.shares(event);
    if (!kind || start.some((share) => share < 0 || share > 1)) return false;
    /** @type {[Point, Point]} */
    const ends = [start, start];
    const follow = (/** @type {PointerEvent} */ at) => {
      ends[1] = inside(this.stage.shares(at));
      this.#draw([{ kind, points: ends }]);
      this.#magnify(ends[1]);
    };
    const finish = (/** @type {PointerEvent} */ at) => {
      this.#magnify(null);
      if (at.type === "pointerup" && apart(...ends) > SHORTEST) {
        const [one, other] = this.#snapped(ends);
        this.#list.push({ kind, points: kind === "straight" ? [one, middle(one, other), other] : [one, other] });
        this.changed();
      }
      this.#draw();
    };
    this.stage.drag(event, (_dx, _dy, at) => follow(at), finish);
    return true;
  }

  /**
   * Shows what is under a finger, larger, next to it, and puts the result where it covers neither.
   * @param {Point | null} point null: no finger is there
   */
  #magnify(point) {
    this.loupe.hidden = !point;
    if (!point) return;
    const { frame, images } = this.stage;
    const [[x, y], side] = [this.#px(point), this.loupe.offsetWidth];
    Object.assign(this.loupe.style, {
      left: `${x}px`,
      top: `${y}px`,
      backgroundImage: `url(${images.before.src})`,
      backgroundSize: `${frame.offsetWidth * LARGER}px ${frame.offsetHeight * LARGER}px`,
      backgroundPosition: `${side / 2 - x * LARGER}px ${side / 2 - y * LARGER}px`,
    });
    this.loupe.classList.toggle("below", y + frame.offsetTop < 1.5 * side);
    frame.classList.toggle("aside", point[0] > 0.5);
  }

  /** Both ends put onto the segments that they are close to, where those run the same way. @param {Point[]} points */
  #snapped(points) {
    const way = unit(this.#px(points[0]), this.#px(points[points.length - 1]));
    return points.map((point) => {
      const at = this.#px(point);
      let nearest = point;
      let best = REACH;
      for (const [x1, y1, x2, y2] of this.segments) {
        const [a, b] = [this.#px([x1, y1]), this.#px([x2, y2])];
        const [dx, dy] = unit(a, b);
        if (Math.abs(dx * way[1] - dy * way[0]) > SLOPE) continue;
        const along = (at[0] - a[0]) * dx + (at[1] - a[1]) * dy;
        const across = Math.abs((at[0] - a[0]) * dy - (at[1] - a[1]) * dx);
        const off = across + 0.2 * Math.max(-along, along - apart(a, b), 0);
        if (off >= best) continue;
        best = off;
        nearest = this.#shares([a[0] + along * dx, a[1] + along * dy]);
      }
      return nearest;
    });
  }

  /** @param {Point} share @returns {Point} */
  #px([x, y]) {
    return [x * this.stage.frame.offsetWidth, y * this.stage.frame.offsetHeight];
  }

  /** @param {Point} px @returns {Point} */
  #shares([x, y]) {
    return inside([x / this.stage.frame.offsetWidth, y / this.stage.frame.offsetHeight]);
  }

  /** All lines, and one that is being drawn. @param {Line[]} more */
  #draw(more = []) {
    const drawn = [...this.#list, ...more].flatMap(({ kind, points }, k) => {
      const at = points.map((point) => point.join(",")).join(" ");
      const edge = `edge${this.#troubles[k] ? " unmet" : ""}`;
      return [draw("polyline", { class: edge, points: at }), draw("polyline", { class: kind, points: at })];
    });
    this.svg.replaceChildren(...drawn);
    this.#drawEnds();
  }

  /** Ends stay the buttons that they are as long as the lines are the same: one may be held while an answer comes. */
  #drawEnds() {
    const listed = this.#kind === null ? [] : this.#list;
    const ends = listed.flatMap(({ kind, points }, number) =>
      points.map((point, end) => /** @type {End} */ ({ kind, number, end, point })),
    );
    const named = (/** @type {{ id: string, className: string }[]} */ all) => all.map((one) => one.id + one.className);
    const wanted = ends.map((end) => ({ id: idOf(end), className: `end ${end.kind}` }));
    if (`${named(wanted)}` !== `${named([...this.handles.children])}`) {
      const focused = this.handles.contains(document.activeElement) ? document.activeElement?.id : null;
      this.handles.replaceChildren(...ends.map((end) => this.#handle(end)));
      if (focused) document.getElementById(focused)?.focus({ focusVisible: true });
    }
    const handles = /** @type {HTMLElement[]} */ ([...this.handles.children]);
    ends.forEach(({ point: [x, y] }, k) =>
      Object.assign(handles[k].style, { left: `${100 * x}%`, top: `${100 * y}%` }),
    );
  }

  /** @param {End} end */
  #handle({ kind, number, end }) {
    const label = words.lineEnd(words.lineOf[kind], number + 1, end + 1);
    const handle = make(`button.end.${kind}`, { type: "button", id: idOf({ number, end }), "aria-label": label });
    const move = (/** @type {Point} */ point) => {
      this.#list[number].points[end] = inside(point);
      this.#draw();
      this.moving();
    };
    handle.addEventListener("keydown", (event) => {
      if (event.key === "Delete" || event.key === "Backspace") return this.remove(number);
      const way = /** @type {Arrow} */ (event.key.slice("Arrow".length).toLowerCase());
      if (!(way in VECTORS)) return;
      event.preventDefault();
      const [[x, y], [across, down]] = [this.#list[number].points[end], VECTORS[way]];
      move([x + STEP * across, y + STEP * down]);
      this.changed();
    });
    handle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      event.stopPropagation();
      handle.setPointerCapture(event.pointerId);
    });
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      move(this.stage.shares(event));
      this.#magnify(this.#list[number].points[end]);
    });
    handle.addEventListener("lostpointercapture", () => this.#magnify(null));
    handle.addEventListener("pointerup", () => {
      const line = this.#list[number];
      if (kind !== "straight") line.points = this.#snapped(line.points);
      this.#draw();
      this.changed();
    });
    return handle;
  }
}

/** @param {{ number: number, end: number }} end */
const idOf = ({ number, end }) => `end-${number}-${end}`;
/** @param {Point} share @returns {Point} */
const inside = ([x, y]) => [within(x, 0, 1), within(y, 0, 1)];
/** @param {Point} one @param {Point} other @returns {Point} */
const unit = (one, other) => {
  const length = apart(one, other) || 1;
  return [(other[0] - one[0]) / length, (other[1] - one[1]) / length];
};
