// Frames taken just before and after the photo: chosen or dropped here, they say how the camera moved.

import { control, others } from "./described.js";
import { make } from "./nodes.js";
import { Photo } from "./photo.js";
import { check } from "./widgets.js";
import { words } from "./words.js";

const PLACED = ["before", "after", "at", "readout-ratio", "model", "fallback"];

export class Neighbours {
  // changed: called when what is asked for has changed; give(file): a Photo, or null if it cannot be one.
  constructor(changed) {
    this.changed = changed;
    this.photo = null;
    this.places = make("div", { class: "row" });
    const set = (name, value) => this.#set(name, value);
    this.ratio = control("photo", "readout-ratio", "ratio", set);
    this.model = control("photo", "model", "model", set);
    this.fallback = control("photo", "fallback", "fallback", set);
    this.shown = [
      this.ratio,
      this.model,
      this.fallback,
      ...others("photo", PLACED, ["neighbours", "clock"], "option-", set),
    ];
    this.more = make("details", {}, make("summary", {}, words.more), ...this.shown.slice(1).map(({ node }) => node));
    this.timing = make(
      "div",
      {},
      this.ratio.node,
      make("p", { class: "quiet" }, words.ratioHelp),
      ...this.#moment(),
      this.more,
    );
    this.node = make(
      "details",
      { class: "section", id: "neighbours" },
      make("summary", {}, words.neighbours),
      make("p", { class: "quiet" }, words.neighboursHelp),
      this.places,
      this.timing,
    );
  }

  // Shows where neighbours are chosen.
  open() {
    this.node.open = true;
    this.node.scrollIntoView({ block: "nearest" });
    this.places.querySelector("input, button")?.focus();
  }

  // Shows where the ratio is typed.
  askRatio() {
    this.node.open = true;
    this.ratio.field.focus();
  }

  // Leaves all neighbours out.
  clear() {
    for (const which of Object.keys(this.photo.neighbours)) this.#forget(which);
    this.show(this.photo);
    this.changed();
  }

  show(photo) {
    if (photo !== this.photo) this.node.open = Object.keys(photo.neighbours).length > 0;
    this.photo = photo;
    this.places.replaceChildren(...["before", "after"].map((which) => this.#place(which)));
    this.timing.hidden = !Object.keys(photo.neighbours).length;
    const { beside, neighbours } = photo;
    for (const each of this.shown) each.show(beside);
    this.model.field.querySelector("[value=camera]").disabled = "at" in beside; // it knows no other moment
    this.another.field.checked = "at" in beside;
    this.at.disabled = !("at" in beside);
    Object.assign(this.at, { min: neighbours.before ? "-1" : "0", max: neighbours.after ? "1" : "0" });
    this.at.value = beside.at ?? "0";
    this.atSaid.textContent = "at" in beside ? words.at(Number(beside.at)) : "";
  }

  // The moment of the picture: that of the reference row, or any between the frames.
  #moment() {
    this.at = make("input", {
      type: "range",
      id: "at",
      step: "0.05",
      "aria-label": words.atLabel,
      onchange: () => this.#set("at", this.at.value),
    });
    this.at.addEventListener("input", () => (this.atSaid.textContent = words.at(Number(this.at.value))));
    this.atSaid = make("output", { for: "at" });
    this.another = check("another", words.another, (on) => {
      if (on && this.photo.beside.model === "camera") delete this.photo.beside.model;
      this.#set("at", on ? (this.photo.neighbours.after ? "0.5" : "-0.5") : "");
    });
    return [this.another.node, this.at, this.atSaid];
  }

  #set(name, value) {
    if (value === "" || value === false) delete this.photo.beside[name];
    else this.photo.beside[name] = String(value);
    this.show(this.photo);
    this.changed();
  }

  #place(which) {
    const there = this.photo.neighbours[which];
    if (there) {
      return make(
        "span",
        { class: "neighbour" },
        words.neighbourIs[which](there.name),
        make(
          "button",
          {
            type: "button",
            "aria-label": words.neighbourForget,
            title: words.neighbourForget,
            onclick: () => this.#put(which, null),
          },
          "×",
        ),
      );
    }
    const choose = make("input", {
      type: "file",
      class: "away",
      id: `choose-${which}`,
      onchange: (event) => this.#put(which, event.target.files[0]),
    });
    return make(
      "label",
      {
        class: "button",
        ondragover: (event) => event.preventDefault(),
        ondrop: (event) => {
          event.preventDefault();
          event.stopPropagation(); // it is not another photo to straighten
          document.documentElement.classList.remove("dropping");
          if (event.dataTransfer.files.length) this.#put(which, event.dataTransfer.files[0]);
        },
      },
      words.neighbourOf[which],
      choose,
    );
  }

  #forget(which) {
    this.photo.neighbours[which]?.forget();
    delete this.photo.neighbours[which];
    delete this.photo.beside.at; // which may lie on the other side now
    this.photo.neighbourError = "";
  }

  #put(which, file) {
    this.#forget(which);
    if (file) this.photo.neighbours[which] = new Photo(file);
    this.node.open = true;
    this.show(this.photo);
    this.changed();
  }
}
