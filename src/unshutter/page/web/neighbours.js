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

  /** @param {() => void} changed called when what is asked for has changed */
  constructor(changed) {
    this.changed = changed;
    this.places = make("div.row");
    this.form = new Form("photo", (name, value) => this.#set(name, value), [...SIDES, "at"]);
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
    this.timing = make("div", this.ratio.node, quiet(words.ratioHelp), ...moment, opened);
    const parts = [quiet(words.neighboursHelp), this.places, this.timing];
    this.node = section("neighbours", { id: "neighbours" }, ...parts);
  }

  /** Shows where neighbours are chosen. */
  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "nearest" });
    /** @type {HTMLElement | null} */ (this.places.querySelector("input, button"))?.focus();
  }

  /** Shows where the ratio is typed. */
  askRatio() {
    this.node.open = true;
    this.ratio.field.focus();
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

  /** @param {string} name @param {string} value */
  #set(name, value) {
    const { beside } = /** @type {Photo} */ (this.photo);
    if (value === "") delete beside[name];
    else beside[name] = value;
    this.#update();
  }

  #update() {
    this.show(/** @type {Photo} */ (this.photo));
    this.changed();
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
