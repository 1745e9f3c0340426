// The thumbnails: a button for each photo or clip, with its state and how sure the answer is.

import { make, nameParts } from "./nodes.js";
import { words } from "./words.js";

const SIDE = 160; // px, of the longer side
const AT_WORK = ["waiting", "loading", "finding"];

// What each choice of the filter shows: function of a photo or clip.
const FILTERS = {
  all: () => true,
  changed: ({ state, result }) => state === "done" && Boolean(result?.changed),
  look: ({ state, result }) =>
    state === "asking" || (state === "done" && Boolean(result?.changed && result.certainty === "unsure")),
  alone: ({ state, kind, result }) => state === "done" && kind === "photo" && !result.changed,
  failed: ({ state }) => state === "failed",
};

export class Strip {
  #items = new Map();

  // list, bar: where thumbnails, and filter and progress, go; on: {pick(photo), close(photo),
  // filtered(count of those that are shown)}.
  constructor(list, bar, on) {
    this.list = list;
    this.on = on;
    this.filter = "all";
    this.buttons = Object.keys(FILTERS).map((name) =>
      make("button", { type: "button", id: `filter-${name}`, onclick: () => this.show(name) }),
    );
    this.progress = make("progress", { "aria-label": words.allDone });
    this.removeFailed = make(
      "button",
      {
        type: "button",
        id: "remove-failed",
        onclick: () => {
          for (const photo of [...this.#items.keys()].filter(FILTERS.failed)) on.close(photo);
        },
      },
      words.removeFailed,
    );
    bar.replaceChildren(
      make("span", { class: "row", role: "group", "aria-label": words.filter }, ...this.buttons),
      this.removeFailed,
      this.progress,
    );
    this.#count();
  }

  // Shows only some of them.
  show(filter) {
    this.filter = filter;
    this.#count();
  }

  // Those that are shown, in their order.
  get shown() {
    return [...this.#items.keys()].filter(FILTERS[this.filter]);
  }

  // How many each filter shows, and how many of all are looked through.
  #count() {
    const photos = [...this.#items.keys()];
    if (!photos.some(FILTERS[this.filter])) this.filter = "all"; // nothing is left to see
    Object.keys(FILTERS).forEach((name, k) => {
      const count = photos.filter(FILTERS[name]).length;
      this.buttons[k].textContent = words.filterOf[name](count);
      this.buttons[k].disabled = !count;
      this.buttons[k].setAttribute("aria-pressed", name === this.filter);
    });
    for (const [photo, { item }] of this.#items) item.hidden = !FILTERS[this.filter](photo);
    this.removeFailed.hidden = !photos.some(FILTERS.failed);
    this.on.filtered(this.shown.length);
    const done = photos.filter(({ state }) => !AT_WORK.includes(state)).length;
    this.progress.hidden = done === photos.length;
    Object.assign(this.progress, { max: Math.max(photos.length, 1), value: done });
    this.progress.title = words.doneOf(done, photos.length);
  }

  add(photo) {
    const canvas = make("canvas", { width: SIDE, height: SIDE, "aria-hidden": "true" });
    const state = make("span", { class: "state" });
    const pick = make(
      "button",
      { type: "button", class: "thumbnail", title: photo.name, onclick: () => this.on.pick(photo) },
      canvas,
      make("span", { class: "file-name" }, ...nameParts(photo.name)),
      state,
    );
    const close = make(
      "button",
      { type: "button", class: "close", "aria-label": words.close(photo.name), onclick: () => this.on.close(photo) },
      "×",
    );
    const item = make("li", {}, pick, close);
    this.#items.set(photo, { item, pick, canvas, state, drawn: null });
    this.list.append(item);
    photo.addEventListener("change", () => this.update(photo));
    this.update(photo);
  }

  remove(photo) {
    this.#items.get(photo)?.item.remove();
    this.#items.delete(photo);
    this.#count();
  }

  select(photo) {
    for (const [each, { pick }] of this.#items) {
      if (each === photo) pick.setAttribute("aria-current", "true");
      else pick.removeAttribute("aria-current");
    }
    this.#items.get(photo)?.item.scrollIntoView({ block: "nearest", inline: "nearest" });
  }

  update(photo) {
    const item = this.#items.get(photo);
    if (!item) return;
    item.state.textContent = stateOf(photo);
    item.pick.dataset.state =
      photo.state === "done" && photo.kind === "photo" ? (photo.result.changed ? "changed" : "alone") : photo.state;
    item.pick.dataset.sure =
      photo.state === "done" && photo.kind === "photo" && photo.result.changed ? (photo.result.certainty ?? "") : "";
    this.#count();
    const blob = photo.pictures.after?.blob ?? photo.pictures.before?.blob;
    if (blob && blob !== item.drawn) {
      item.drawn = blob;
      paint(item.canvas, blob, SIDE, photo.pictures.after && photo.result?.crop);
    }
  }
}

export function stateOf(photo) {
  if (photo.kind === "clip" && photo.state in words.clipState) {
    return ["opened", "done"].includes(photo.state) && photo.kept ? words.clipStateSaved : words.clipState[photo.state];
  }
  if (photo.state === "done") {
    if (!photo.result.changed) return words.alone;
    const state = photo.byHand ? words.changedByHand : words.changed(words.sure[photo.result.certainty]);
    return photo.kept ? words.savedToo(state) : state;
  }
  return photo.state === "loading" ? words.loading(photo.loaded) : words[photo.state];
}

// Draws what a crop leaves of a picture as large as the side allows [px]; crop: left, top, right, bottom, shares.
export async function paint(canvas, blob, side, crop) {
  const picture = await createImageBitmap(blob);
  const [left, top, right, bottom] = crop ?? [0, 0, 1, 1];
  const [width, height] = [(right - left) * picture.width, (bottom - top) * picture.height];
  const scale = Math.min(side / width, side / height);
  canvas.width = width * scale;
  canvas.height = height * scale;
  canvas
    .getContext("2d")
    .drawImage(picture, left * picture.width, top * picture.height, width, height, 0, 0, canvas.width, canvas.height);
  picture.close();
}
