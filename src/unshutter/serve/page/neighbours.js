// Frames taken just before and after the photo: chosen or dropped here, they say how the camera moved.

import { make } from "./nodes.js";
import { Photo } from "./photo.js";
import { words } from "./words.js";

export class Neighbours {
  // changed: called when what is asked for has changed; give(file): a Photo, or null if it cannot be one.
  constructor(changed) {
    this.changed = changed;
    this.photo = null;
    this.places = make("div", { class: "row" });
    this.ratio = make("input", { type: "number", id: "ratio", min: "0.01", max: "1", step: "0.01", onchange: () => {
      if (!this.ratio.checkValidity()) return;
      this.photo.ratio = this.ratio.value;
      this.changed();
    } });
    this.timing = make("div", {}, make("label", { class: "field", for: "ratio" }, words.ratio, this.ratio),
      make("p", { class: "quiet" }, words.ratioHelp));
    this.node = make("fieldset", {}, make("legend", {}, words.neighbours),
      make("p", { class: "quiet" }, words.neighboursHelp), this.places, this.timing);
  }

  show(photo) {
    this.photo = photo;
    this.places.replaceChildren(...["before", "after"].map((which) => this.#place(which)));
    this.timing.hidden = !Object.keys(photo.neighbours).length;
    if (document.activeElement !== this.ratio) this.ratio.value = photo.ratio;
  }

  #place(which) {
    const there = this.photo.neighbours[which];
    if (there) {
      return make("span", { class: "neighbour" }, words.neighbourIs[which](there.name),
        make("button", { type: "button", "aria-label": words.neighbourForget, title: words.neighbourForget,
          onclick: () => this.#put(which, null) }, "×"));
    }
    const choose = make("input", { type: "file", class: "away", id: `choose-${which}`,
      onchange: (event) => this.#put(which, event.target.files[0]) });
    return make("label", { class: "button", ondragover: (event) => event.preventDefault(), ondrop: (event) => {
      event.preventDefault();
      event.stopPropagation(); // it is not another photo to straighten
      document.documentElement.classList.remove("dropping");
      if (event.dataTransfer.files.length) this.#put(which, event.dataTransfer.files[0]);
    } }, words.neighbourOf[which], choose);
  }

  #put(which, file) {
    this.photo.neighbours[which]?.forget();
    if (file) this.photo.neighbours[which] = new Photo(file);
    else delete this.photo.neighbours[which];
    this.show(this.photo);
    this.changed();
  }
}
