// The thumbnails: a button for each photo or clip, with its state and how sure the answer is.

/** @import { Photo } from "./photo.js" @import { Box, Item } from "./types.js" */

import { make, putName } from "./nodes.js";
import { AT_WORK, shownState } from "./states.js";
import { button, press } from "./widgets.js";
import { words } from "./words.js";

const SIDE = 160; // px, of the longer side

/** @typedef {keyof typeof words.filterOf} Filter */

/** Whether there is an answer, which one that is looked at keeps while larger pictures are made. @param {Item} item */
const known = ({ state, result }) => state === "done" || (state === "finding" && result !== null);

/** What each choice of the filter shows. @type {Record<Filter, (item: Item) => boolean>} */
const FILTERS = {
  all: () => true,
  changed: (item) => known(item) && Boolean(item.result?.changed),
  look: (item) => item.state === "asking" || (FILTERS.changed(item) && item.kind === "photo" && isDoubted(item)),
  alone: (item) => item.kind === "photo" && known(item) && !item.result?.changed,
  failed: ({ state }) => state === "failed",
};
const NAMES = /** @type {Filter[]} */ (Object.keys(FILTERS));

/** @param {Item} item */
const certaintyOf = (item) => (item.kind === "photo" && !levelled(item) && item.result?.certainty) || "";

/** @param {Photo} photo */
const isDoubted = (photo) => !levelled(photo) && Boolean(photo.result?.doubted);

/** Whether a photo was levelled, but its motion was not undone. @param {Item} item */
const levelled = ({ kind, result }) => kind === "photo" && Boolean(result?.changed && result.code);

/** @typedef {{ pick(item: Item): void, close(item: Item): void, filtered(shown: number): void }} On */

export class Strip {
  /** @type {Map<Item, ReturnType<Strip["thumbnail"]>>} */
  #items = new Map();

  /**
   * @param {HTMLElement} list where thumbnails go @param {HTMLElement} bar where filter and progress go @param {On} on
   */
  constructor(list, bar, on) {
    this.list = list;
    this.on = on;
    /** @type {Filter} */
    this.filter = "all";
    this.buttons = NAMES.map((name) => press(`filter-${name}`, "", () => this.show(name)));
    this.see = button("seeChanged", () => {
      this.show("changed");
      on.pick(this.shown[0]);
    });
    this.progress = make("progress", { "aria-label": words.allDone });
    this.removeFailed = button("removeFailed", () => this.#these("failed").forEach(on.close));
    const group = make("span.row", { role: "group", "aria-label": words.filter }, ...this.buttons);
    bar.replaceChildren(this.see, group, this.removeFailed, this.progress);
    this.#count();
  }

  /** Shows only some of them. @param {Filter} filter */
  show(filter) {
    this.filter = filter;
    this.#count();
  }

  /** Those that are shown, in their order. */
  get shown() {
    return this.#these(this.filter);
  }

  /** @param {Filter} filter */
  #these(filter) {
    return [...this.#items.keys()].filter(FILTERS[filter]);
  }

  /** How many each filter shows, and how many of all are looked through. */
  #count() {
    if (!this.shown.length) this.filter = "all"; // nothing is left to see
    NAMES.forEach((name, k) => {
      const [each, count] = [this.buttons[k], this.#these(name).length];
      each.textContent = words.filterOf[name](count, this.#these(name).some(levelled));
      each.disabled = !count;
      each.setAttribute("aria-pressed", String(name === this.filter));
    });
    for (const [item, { node }] of this.#items) node.hidden = !FILTERS[this.filter](item);
    this.removeFailed.hidden = !this.#these("failed").length;
    this.on.filtered(this.shown.length);
    const all = this.#these("all");
    const done = all.filter(({ state }) => !AT_WORK.includes(state)).length;
    this.progress.hidden = done === all.length;
    const changed = this.#these("changed");
    this.see.hidden = done < all.length || !changed.length || changed.length === all.length || this.filter !== "all";
    this.see.textContent = words.changedOf(changed.length, all.length, changed.some(levelled));
    Object.assign(this.progress, { max: Math.max(all.length, 1), value: done });
    this.progress.title = words.doneOf(done, all.length);
  }

  /** @param {Item} item */
  add(item) {
    const made = this.thumbnail(item);
    this.#items.set(item, made);
    this.list.append(made.node);
    item.addEventListener("change", () => this.update(item));
    this.update(item);
  }

  /** @param {Item} item */
  thumbnail(item) {
    const canvas = make("canvas", { width: SIDE, height: SIDE, "aria-hidden": "true" });
    const [name, state] = [putName(make("span.file-name"), item.name), make("span.state")];
    const picks = { type: "button", title: item.name, onclick: () => this.on.pick(item) };
    const pick = make("button.thumbnail", picks, canvas, name, state);
    const closes = { type: "button", "aria-label": words.close(item.name), onclick: () => this.on.close(item) };
    const node = make("li", pick, make("button.close", closes, "×"));
    return { node, pick, canvas, state, drawn: /** @type {Blob | null} */ (null) };
  }

  /** @param {Item} item */
  remove(item) {
    this.#items.get(item)?.node.remove();
    this.#items.delete(item);
    this.#count();
  }

  /** @param {Item} item */
  select(item) {
    for (const [each, { pick }] of this.#items) {
      if (each === item) pick.setAttribute("aria-current", "true");
      else pick.removeAttribute("aria-current");
    }
    this.#items.get(item)?.node.scrollIntoView({ block: "nearest", inline: "nearest" });
  }

  /** @param {Item} item */
  update(item) {
    const made = this.#items.get(item);
    if (!made) return;
    const shown = shownState(item);
    made.state.title = made.state.textContent = stateSaid(item);
    made.pick.dataset.state = shown;
    made.pick.dataset.sure = shown === "changed" ? certaintyOf(item) : "";
    this.#count();
    const { before, after } = item.pictures;
    const blob = (after ?? before ?? item.glimpse)?.blob;
    if (blob && blob !== made.drawn) {
      made.drawn = blob;
      paint(made.canvas, blob, SIDE, after && item.result?.crop);
    }
  }
}

/** The state of a photo or clip in words. @param {Item} item */
export function stateSaid(item) {
  const shown = shownState(item);
  if (shown === "loading") return words.state.loading(item.loaded);
  if ((shown === "done" || shown === "waiting") && item.kept) return words.saved;
  if (shown !== "changed") return words.state[shown];
  const sure = certaintyOf(item);
  const byHand = item.kind === "photo" && item.byHand;
  const said = levelled(item) ? words.levelled : byHand ? words.changedByHand : words.state.changed(sure);
  return item.kept ? `${words.saved} · ${said}` : said; // the end may not find room
}

/**
 * Draws what a crop leaves of a picture as large as the side allows [px].
 * @param {HTMLCanvasElement} canvas @param {Blob} blob @param {number} side @param {Box | null} [crop]
 */
export async function paint(canvas, blob, side, crop) {
  const picture = await createImageBitmap(blob);
  const [left, top, right, bottom] = crop ?? [0, 0, 1, 1];
  const [x, y] = [left * picture.width, top * picture.height];
  const [width, height] = [(right - left) * picture.width, (bottom - top) * picture.height];
  const scale = Math.min(side / width, side / height);
  Object.assign(canvas, { width: width * scale, height: height * scale });
  canvas.getContext("2d")?.drawImage(picture, x, y, width, height, 0, 0, canvas.width, canvas.height);
  picture.close();
}
