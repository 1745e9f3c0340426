// A line to lay along something level: it tells how the camera was held.

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

const STEP = 0.002; // share of the picture for a press of an arrow key
const STEEPEST = 45; // degrees

// Roll and tilt [degrees] of the camera, from a level line between two points in shares of a picture of that size [px].
// Turned clockwise, a camera sees the level line fall to the left; looking up, it sees the horizon below the middle.
export function attitude(ends, { width, height, focal_px: focal }, isHorizon) {
  const [[x1, y1], [x2, y2]] = ends[0][0] <= ends[1][0] ? ends : [ends[1], ends[0]];
  const [right, down] = [(x2 - x1) * width, (y2 - y1) * height];
  const slope = Math.atan2(down, right);
  const roll = (-slope * 180) / Math.PI;
  if (!(Math.abs(roll) <= STEEPEST) || (right === 0 && down === 0)) return null;
  if (!isHorizon) return { roll, tilt: null };
  const [dx, dy] = [(x1 - 0.5) * width, (y1 - 0.5) * height];
  const below = dy * Math.cos(slope) - dx * Math.sin(slope); // of the middle, across the line [px]
  return { roll, tilt: (Math.atan2(below, focal) * 180) / Math.PI };
}

export class Horizon {
  #ends = [[0.2, 0.5], [0.8, 0.5]];

  // frame: lies over the picture; done: called with the ends whenever one was let go.
  constructor(frame, done) {
    this.done = done;
    this.line = draw("line", {});
    this.svg = draw("svg", { class: "level", viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true" }, this.line);
    this.handles = [0, 1].map((which) => this.#handle(which));
    this.frame = frame;
  }

  show(ends) {
    this.#ends = (ends ?? [[0.2, 0.5], [0.8, 0.5]]).map((end) => [...end]);
    this.frame.append(this.svg, ...this.handles);
    this.#place();
  }

  hide() {
    for (const node of [this.svg, ...this.handles]) node.remove();
  }

  get shown() {
    return this.svg.isConnected;
  }

  #handle(which) {
    const handle = make("button", { type: "button", class: "end", "aria-label": words.horizonEnd(which) });
    handle.addEventListener("keydown", (event) => {
      const moves = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
      if (!(event.key in moves)) return;
      event.preventDefault();
      const [dx, dy] = moves[event.key];
      this.#move(which, this.#ends[which][0] + dx, this.#ends[which][1] + dy);
      this.done(this.#ends);
    });
    handle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      handle.focus();
      handle.setPointerCapture(event.pointerId);
    });
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const box = this.frame.getBoundingClientRect();
      this.#move(which, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    });
    handle.addEventListener("pointerup", () => this.done(this.#ends));
    return handle;
  }

  #move(which, x, y) {
    this.#ends[which] = [x, y].map((share) => Math.min(Math.max(share, 0), 1));
    this.#place();
  }

  #place() {
    const [[x1, y1], [x2, y2]] = this.#ends;
    for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) this.line.setAttribute(name, value);
    this.handles.forEach((handle, which) => {
      handle.style.left = `${100 * this.#ends[which][0]}%`;
      handle.style.top = `${100 * this.#ends[which][1]}%`;
    });
  }
}
