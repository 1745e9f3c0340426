// Frames taken just before and after the photo: chosen or dropped here, they say how the camera moved.

/** @import { Which } from "./types.js" */

import { Form } from "./form.js";
import { make } from "./nodes.js";
import { Photo } from "./photo.js";
import { check, quiet, section } from "./widgets.js";
import { words } from "./words.js";

export const GROUPS = ["neighbours", "clock"]; // of options
const SIDES = /** @type {const} */ (["before", "after"]);

export class Neighbours {
  /** @type {Photo | null} */
  photo = null;

  /** @param {{ refresh(): void, draft(): void }} on called when what is asked for has changed, or is being dragged */
  constructor(on) {
    this.on = on;
    this.places = make("div.row");
    this.form = new Form("photo", (name, value, dragged) => this.#set(name, value, dragged), [...SIDES, "at"]);
    this.ratio = this.form.control("readout-ratio", "ratio");
    this.model = this.form.control("model");
    const more = [this.model, this.form.control("fallback"), ...this.form.rest((group) => GROUPS.includes(group))];
    this.another = check("another", words.another, (on) => this.#moveMoment(on));
    const range = { type: "range", id: "at", step: "0.05", "aria-label": words.atLabel };
    this.at = make("input", range, {
      onchange: () => this.#set("at", this.at.value),
      oninput: () => this.#sayMoment(),
    });
    this.atSaid = make("output", { for: "at" });
    const opened = make("details", make("summary", words.more), ...more.map(({ node }) => node));
    const moment = [this.another.node, this.at, this.atSaid];
    this.ratioSaid = quiet();
    this.timing = make("div", this.ratio.node, this.ratioSaid, ...moment, opened);
    const parts = [quiet(words.neighboursHelp), this.places, this.timing];
    this.node = section("neighbours", { id: "neighbours" }, ...parts);
  }

  /** Shows where neighbours are chosen. */
  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "nearest" });
    /** @type {HTMLElement | null} */ (this.places.querySelector("input, button"))?.focus();
  }

  /** Shows the readout ratio, and what else there is to say of neighbours. */
  showTiming() {
    this.node.open = true;
    this.ratio.node.scrollIntoView({ block: "center" });
  }

  /** Leaves all neighbours out. */
  clear() {
    for (const which of SIDES) this.#forget(which);
    this.#update();
  }

  /** @param {Photo} photo */
  show(photo) {
    const { beside, neighbours, hasNeighbours } = photo;
    if (photo !== this.photo) this.node.open = hasNeighbours;
    this.photo = photo;
    this.places.replaceChildren(...SIDES.map((which) => this.#place(which, photo)));
    this.timing.hidden = !hasNeighbours;
    this.form.show(beside);
    const ratio = "readout-ratio" in beside ? null : photo.result?.ratio;
    if (ratio) this.ratio.show({ "readout-ratio": String(ratio.value) });
    this.ratioSaid.textContent = `${ratio ? words.ratioFrom(ratio.source) : ""} ${words.ratioHelp}`;
    const between = "at" in beside;
    const camera = /** @type {HTMLOptionElement} */ (this.model.field.querySelector("[value=camera]"));
    camera.disabled = between; // it knows no other moment
    this.another.field.checked = between;
    Object.assign(this.at, { min: neighbours.before ? "-1" : "0", max: neighbours.after ? "1" : "0" });
    Object.assign(this.at, { value: beside.at ?? "0", disabled: !between });
    this.#sayMoment();
  }

  #sayMoment() {
    this.atSaid.textContent = this.at.disabled ? "" : words.at(Number(this.at.value));
  }

  /** Another moment than that of the reference row: any between the frames. @param {boolean} on */
  #moveMoment(on) {
    const { beside, neighbours } = /** @type {Photo} */ (this.photo);
    if (on && beside.model === "camera") delete beside.model;
    this.#set("at", on ? (neighbours.after ? "0.5" : "-0.5") : "");
  }

  /** @param {string} name @param {string} value @param {boolean} [dragged] */
  #set(name, value, dragged) {
    const photo = /** @type {Photo} */ (this.photo);
    if (dragged) photo.beside[name] = value;
    else photo.setBeside(name, value);
    if (dragged) this.on.draft();
    else this.#update();
  }

  #update() {
    this.show(/** @type {Photo} */ (this.photo));
    this.on.refresh();
  }

  /** @param {Which} which @param {Photo} photo */
  #place(which, { neighbours }) {
    const there = neighbours[which];
    if (there) {
      const forgets = { "aria-label": words.neighbourForget, title: words.neighbourForget };
      const forget = make("button", { type: "button", ...forgets, onclick: () => this.#put(which) }, "×");
      return make("span.neighbour", words.neighbourIs[which](there.name), forget);
    }
    const choose = make("input.away", { type: "file", id: `choose-${which}` });
    choose.addEventListener("change", () => this.#put(which, choose.files?.[0]));
    const drop = (/** @type {DragEvent} */ event) => {
      event.preventDefault();
      event.stopPropagation(); // it is not another photo to straighten
      document.documentElement.classList.remove("dropping");
      if (event.dataTransfer?.files.length) this.#put(which, event.dataTransfer.files[0]);
    };
    const listeners = { ondragover: (/** @type {DragEvent} */ event) => event.preventDefault(), ondrop: drop };
    return make("label.button", listeners, words.neighbourOf[which], choose);
  }

  /** @param {Which} which */
  #forget(which) {
    const photo = /** @type {Photo} */ (this.photo);
    photo.neighbours[which]?.forget();
    delete photo.neighbours[which];
    delete photo.beside.at; // which may lie on the other side now
    photo.trouble = null;
  }

  /** @param {Which} which @param {File} [file] none: there is no neighbour any more */
  #put(which, file) {
    this.#forget(which);
    if (file && this.photo) this.photo.neighbours[which] = new Photo(file);
    this.node.open = true;
    this.#update();
  }
}
