// The motion as two curves over the rows, first row on top.

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

const [WIDTH, HEIGHT, PAD] = [120, 110, 6];

/** @param {number[]} sideways t_x [px] @param {number[]} turning r_z [degrees] */
export function curves(sideways, turning) {
  const both = [curve(words.curveTx, sideways, 1), curve(words.curveRz, turning, 2)];
  return make("figure.curves", ...both, make("figcaption", words.curvesHelp));
}

/** @param {string} name @param {number[]} values @param {number} digits */
function curve(name, values, digits) {
  const most = Math.max(...values.map(Math.abs), 10 ** -digits);
  const across = (/** @type {number} */ value) => WIDTH / 2 + (value / most) * (WIDTH / 2 - PAD);
  const down = (/** @type {number} */ index) => PAD + ((HEIGHT - 2 * PAD) * index) / (values.length - 1);
  const points = values.map((value, index) => `${across(value).toFixed(1)},${down(index).toFixed(1)}`).join(" ");
  const said = `${name}: ${values[0].toFixed(digits)} … ${values[values.length - 1].toFixed(digits)}`;
  const zero = draw("line", { class: "zero", x1: WIDTH / 2, x2: WIDTH / 2, y1: 0, y2: HEIGHT });
  const box = { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": said };
  const scale = make("span.scale", make("span", `−${most.toFixed(digits)}`), make("span", most.toFixed(digits)));
  return make("div", make("span", name), draw("svg", box, zero, draw("polyline", { points })), scale);
}
