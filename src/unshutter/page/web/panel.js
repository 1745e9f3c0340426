// What the panels beside photos and clips have in common: what was done, controls of options, and saving.

/** @import { Item, Kind, Options } from "./types.js" @import { Word } from "./words.js" */

import { Form } from "./form.js";
import { make, refill } from "./nodes.js";
import { button, row } from "./widgets.js";
import { words } from "./words.js";

const OWN = ["roll-deg", "tilt-deg", "exposure-s", "candidate", "start", "end"]; // true of one photo or clip alone

/** @typedef {{ refresh(): void, save(): void, toAll(): void }} On called when the user wants that */

/** @template {Item} T */
export class Panel {
  /** @type {T | null} */
  item = null;

  /**
   * @param {HTMLElement} panel @param {Kind} kind @param {On} on @param {Word} save its button
   * @param {string[]} elsewhere options that have another place
   */
  constructor(panel, kind, on, save, elsewhere) {
    this.panel = panel;
    this.on = on;
    this.said = make("div.said", { role: "status" });
    this.save = button(save, () => on.save(), { class: "main" });
    this.form = new Form(kind, (name, value, dragged) => this.set(name, value, dragged), elsewhere);
  }

  /**
   * @param {Word} unsavable why nothing can be saved @param {HTMLElement[]} controls
   * @param {HTMLElement[]} ahead those that stand below the button that saves
   */
  fill(unsavable, controls, ahead = []) {
    this.whyNot = make("p.quiet.why-not", /** @type {string} */ (words[unsavable]));
    const above = [make("div.row.actions", this.save), ...ahead, this.whyNot];
    this.panel.replaceChildren(...above, make("h2", words.done), this.said, make("h2", words.settings), ...controls);
  }

  /** The control of an option, for the panel. @param {string} name */
  control = (name) => this.form.control(name).node;

  /** @param {string} name @param {string} value @param {boolean} [_dragged] */
  set(name, value, _dragged) {
    this.item?.set(name, value);
    this.on.refresh();
  }

  /** Shows the options of a photo or clip. @param {T} item */
  show(item) {
    this.item = item;
    this.form.show(item.options);
  }

  reset() {
    this.item?.reset();
    this.on.refresh();
  }

  /** Buttons at the end. @param {Word} toAll @param {Word} reset */
  buttons(toAll, reset) {
    this.toAll = button(toAll, () => this.on.toAll());
    return row(
      this.toAll,
      button(reset, () => this.reset()),
    );
  }

  /** @param {HTMLElement[]} lines what was done @param {boolean} savable @param {boolean} why whether to say why not */
  say(lines, savable, why) {
    refill(this.said, lines);
    this.save.disabled = !savable;
    if (this.whyNot) this.whyNot.hidden = savable || !why;
  }
}

/**
 * The options of another photo or clip, once those of this one hold for it, too.
 * @param {Options} options @param {Options} others
 */
export function shared(options, others) {
  const some = (/** @type {Options} */ all, /** @type {boolean} */ own) =>
    Object.entries(all).filter(([name]) => OWN.includes(name) === own);
  return Object.fromEntries([...some(options, false), ...some(others, true)]);
}
