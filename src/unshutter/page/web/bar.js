// The bar over the picture: its name, which one is shown, and how.

/** @import { Stage } from "./stage.js" */

import { draw, make, putName } from "./nodes.js";
import { button, signed } from "./widgets.js";
import { percent, words } from "./words.js";

const GRID = "M6 2v12M10 2v12M2 6h12M2 10h12";
const CORNERS = "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4";

/** @param {string} d */
const icon = (d) => draw("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, draw("path", { d }));

/** @typedef {{ step(by: number): void, close(): void, fullScreen(): void }} On */

export class Bar {
  /** @param {HTMLElement} node where to @param {Stage} stage @param {On} on called when the user wants that */
  constructor(node, stage, on) {
    this.stage = stage;
    this.name = make("output.file-name", { id: "name" });
    this.steps = [signed("previous", "‹", () => on.step(-1)), signed("next", "›", () => on.step(1))];
    this.grid = signed("grid", icon(GRID), () => this.toggleGrid());
    this.grid.setAttribute("aria-pressed", "false");
    this.zoom = this.#zoom();
    const close = signed("closeThis", "×", on.close);
    const zooms = [signed("zoomOut", "−", stage.zoomOut), this.zoom, signed("zoomIn", "+", stage.zoomIn)];
    const full = signed("fullScreen", icon(CORNERS), on.fullScreen);
    const original = button("original", () => {}, { title: words.originalHelp });
    const hold = (/** @type {Event} */ event) => {
      const key = event instanceof KeyboardEvent && event.type === "keydown" && [" ", "Enter"].includes(event.key);
      stage.original = key || event.type === "pointerdown";
    };
    for (const name of ["pointerdown", "pointerup", "pointercancel", "pointerleave", "keydown", "keyup", "blur"]) {
      original.addEventListener(name, hold);
    }
    const [previous, next] = this.steps;
    node.replaceChildren(previous, this.name, next, close, make("span.gap"), original, ...zooms, this.grid, full);
  }

  /** @param {string} name of the photo or clip that is shown */
  show(name) {
    putName(this.name, name).title = name;
  }

  /** Whether there is another one to go to. @param {boolean} many */
  set many(many) {
    for (const step of this.steps) step.hidden = !many;
  }

  toggleGrid() {
    this.grid.setAttribute("aria-pressed", String(this.stage.toggleGrid()));
  }

  /** The zoom has changed. */
  zoomed() {
    this.zoom.options[0].textContent = percent(this.stage.scale);
  }

  #zoom() {
    const choices = [["", ""], ...words.zoomTo]; // the first says the present zoom
    const options = choices.map(([value, said]) => make("option", { value, hidden: !value }, said));
    const field = make("select", { id: "zoom", title: words.zoomHelp, "aria-label": words.zoom }, ...options);
    field.addEventListener("change", () => {
      const scale = Number(field.value);
      if (scale) this.stage.zoomTo(scale);
      else this.stage.whole();
      field.value = "";
    });
    return field;
  }
}
