// The motion as two curves over the rows, first row on top.

import { draw, make } from "./nodes.js";
import { words } from "./words.js";

const [WIDTH, HEIGHT, PAD] = [120, 110, 6];

export function curves(result) {
  const figure = make("figure", { class: "curves" });
  for (const [name, values, unit] of [
    [words.curveTx, result.tx_px, 1],
    [words.curveRz, result.rz_deg, 2],
  ])
    figure.append(curve(name, values, unit));
  figure.append(make("figcaption", {}, words.curvesHelp));
  return figure;
}

function curve(name, values, digits) {
  const most = Math.max(...values.map(Math.abs), 10 ** -digits);
  const at = (value, index) => [
    (WIDTH / 2) * (1 + (value / most) * (1 - (2 * PAD) / WIDTH)),
    PAD + ((HEIGHT - 2 * PAD) * index) / (values.length - 1),
  ];
  const points = values
    .map((value, index) =>
      at(value, index)
        .map((x) => x.toFixed(1))
        .join(","),
    )
    .join(" ");
  const said = `${name}: ${values[0].toFixed(digits)} … ${values[values.length - 1].toFixed(digits)}`;
  return make(
    "div",
    {},
    make("span", {}, name),
    draw(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": said },
      draw("line", { class: "zero", x1: WIDTH / 2, x2: WIDTH / 2, y1: 0, y2: HEIGHT }),
      draw("polyline", { points }),
    ),
    make(
      "span",
      { class: "scale" },
      make("span", {}, `−${most.toFixed(digits)}`),
      make("span", {}, most.toFixed(digits)),
    ),
  );
}
