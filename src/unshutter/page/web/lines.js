// Lines that the user draws along things in the photo before it is straightened: upright, level, or bent though straight.

import { draw, make } from "./nodes.js";
import { overlay } from "./stage.js";
import { words } from "./words.js";

export const KINDS = ["upright", "level", "straight"];
const STEP = 0.002; // share of the picture for a press of an arrow key
const SHORTEST = 0.03; // share of the picture: shorter drags draw nothing
const LARGER = 3; // times, in the loupe
const REACH = 10; // CSS px within which an end snaps to a segment
const SLOPE = Math.sin((6 * Math.PI) / 180); // between a line and a segment that it snaps to

export class Lines {
  #kind = null;
  #list = [];
  #segments = [];
  #troubles = [];

  // stage: on which they are drawn; changed: called when a line was drawn, moved or removed; moving: while one is moved.
  constructor(stage, changed, moving) {
    this.stage = stage;
    this.changed = changed;
    this.moving = moving;
    this.svg = overlay("drawn");
    this.handles = make("div", { class: "ends" });
    this.loupe = make("div", { class: "loupe", hidden: true, "aria-hidden": "true" });
    stage.frame.append(this.svg, this.handles, this.loupe);
  }

  // Shows a photo's lines: [{kind, points: [[x, y], ...]}, ...], which it changes, and the trouble with each of them.
  show(list, troubles = []) {
    this.#list = list;
    this.#troubles = troubles;
    this.#draw();
  }

  // What the next drag on the picture draws; null: nothing, and no line can be changed.
  get kind() {
    return this.#kind;
  }

  set kind(kind) {
    this.#kind = kind;
    this.stage.mode = kind === null ? "" : "drawing";
    this.stage.tool = (event) => this.#begin(event);
    this.#draw();
  }

  // Segments that ends snap to: [[x, y, x, y], ...], shares.
  set segments(segments) {
    this.#segments = segments;
  }

  // A line in the middle, to be moved by its ends: for those who use the keyboard.
  add(kind) {
    const points = {
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
    this.#list.push({ kind, points: points[kind] });
    this.#draw();
    this.handles.querySelector(`[data-line="${this.#list.length - 1}"]`).focus();
    this.changed();
  }

  remove(number) {
    this.#list.splice(number, 1);
    this.#draw();
    this.changed();
  }

  #begin(event) {
    const start = this.stage.shares(event);
    if (start.some((share) => share < 0 || share > 1)) return false;
    const line = { kind: this.#kind, points: [start, start] };
    this.stage.drag(
      event,
      (_dx, _dy, at) => {
        line.points = [start, this.stage.shares(at).map(clipped)];
        this.#draw(line);
        this.#magnify(line.points[1]);
      },
      (at) => {
        this.#magnify(null);
        const [[x1, y1], [x2, y2]] = line.points;
        if (at.type === "pointerup" && Math.hypot(x2 - x1, y2 - y1) > SHORTEST) {
          line.points = this.#snapped(line.points);
          if (line.kind === "straight") line.points.splice(1, 0, middle(line.points));
          this.#list.push(line);
          this.changed();
        }
        this.#draw();
      },
    );
    return true;
  }

  // Shows what is under a finger, larger, next to it, and puts the result where it covers neither; null: no finger is there.
  #magnify(point) {
    this.loupe.hidden = !point;
    if (!point) return;
    const { frame, images } = this.stage;
    const [[x, y], side] = [this.#px(point), this.loupe.offsetWidth];
    const [width, height] = [frame.offsetWidth * LARGER, frame.offsetHeight * LARGER];
    Object.assign(this.loupe.style, {
      left: `${x}px`,
      top: `${y}px`,
      backgroundImage: `url(${images.before.src})`,
      backgroundSize: `${width}px ${height}px`,
      backgroundPosition: `${side / 2 - x * LARGER}px ${side / 2 - y * LARGER}px`,
    });
    this.loupe.classList.toggle("below", y + frame.offsetTop < 1.5 * side);
    frame.classList.toggle("aside", point[0] > 0.5);
  }

  // Both ends put onto the segments that they are close to, where those run the same way.
  #snapped(points) {
    const [one, other] = [points[0], points[points.length - 1]].map((point) => this.#px(point));
    const way = unit(one, other);
    return points.map((point) => {
      const at = this.#px(point);
      let [best, nearest] = [REACH, null];
      for (const [x1, y1, x2, y2] of this.#segments) {
        const [a, b] = [this.#px([x1, y1]), this.#px([x2, y2])];
        const [dx, dy] = unit(a, b);
        if (Math.abs(dx * way[1] - dy * way[0]) > SLOPE) continue;
        const along = (at[0] - a[0]) * dx + (at[1] - a[1]) * dy;
        const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
        const off = Math.abs((at[0] - a[0]) * dy - (at[1] - a[1]) * dx) + 0.2 * Math.max(-along, along - length, 0);
        if (off < best) [best, nearest] = [off, [a[0] + along * dx, a[1] + along * dy]];
      }
      return nearest ? this.#shares(nearest) : point;
    });
  }

  #px([x, y]) {
    return [x * this.stage.frame.offsetWidth, y * this.stage.frame.offsetHeight];
  }

  #shares([x, y]) {
    return [clipped(x / this.stage.frame.offsetWidth), clipped(y / this.stage.frame.offsetHeight)];
  }

  // All lines, and the one that is being drawn.
  #draw(another = null) {
    const lines = another ? [...this.#list, another] : this.#list;
    this.svg.replaceChildren(
      ...lines.flatMap(({ kind, points }, k) => {
        const at = points.map((point) => point.join(",")).join(" ");
        const unmet = this.#troubles[k] ? " unmet" : "";
        return [draw("polyline", { class: `edge${unmet}`, points: at }), draw("polyline", { class: kind, points: at })];
      }),
    );
    this.#drawEnds();
  }

  // Ends stay the buttons that they are as long as the lines are the same ones: one may be held while an answer comes.
  #drawEnds() {
    const ends =
      this.#kind === null
        ? []
        : this.#list.flatMap(({ kind, points }, number) => points.map((point, end) => ({ kind, number, end, point })));
    const shown = [...this.handles.children];
    if (
      shown.length !== ends.length ||
      shown.some((handle, k) => handle.id !== idOf(ends[k]) || !handle.classList.contains(ends[k].kind))
    ) {
      const focused = this.handles.contains(document.activeElement) ? document.activeElement.id : null;
      this.handles.replaceChildren(...ends.map((end) => this.#handle(end)));
      if (focused) document.getElementById(focused)?.focus({ focusVisible: true });
    }
    ends.forEach(({ point: [x, y] }, k) =>
      Object.assign(this.handles.children[k].style, { left: `${100 * x}%`, top: `${100 * y}%` }),
    );
  }

  #handle({ kind, number, end }) {
    const handle = make("button", {
      type: "button",
      class: `end ${kind}`,
      id: idOf({ number, end }),
      "data-line": number,
      "aria-label": words.lineEnd(words.lineOf[kind], number + 1, end + 1),
    });
    const move = (point) => {
      this.#list[number].points[end] = point.map(clipped);
      this.#draw();
      this.moving();
    };
    handle.addEventListener("keydown", (event) => {
      if (event.key === "Delete" || event.key === "Backspace") return this.remove(number);
      const moves = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
      if (!(event.key in moves)) return;
      event.preventDefault();
      move(this.#list[number].points[end].map((share, k) => share + moves[event.key][k]));
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

const idOf = ({ number, end }) => `end-${number}-${end}`;
const clipped = (share) => Math.min(Math.max(share, 0), 1);
const middle = ([[x1, y1], [x2, y2]]) => [(x1 + x2) / 2, (y1 + y2) / 2];
const unit = ([x1, y1], [x2, y2]) => {
  const length = Math.hypot(x2 - x1, y2 - y1) || 1;
  return [(x2 - x1) / length, (y2 - y1) / length];
};
