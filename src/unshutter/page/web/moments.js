// What the row under the picture offers of a clip: its moments.

/** @import { Item } from "./types.js" */

import { PictureRow } from "./picture_row.js";
import { AT_WORK } from "./states.js";
import { words } from "./words.js";

/** @type {null[]} */
const UNKNOWN = Array(5).fill(null); // they keep their place, so that the picture does not move later

export class Moments extends PictureRow {
  /** Shows those of a clip; of a photo, none. @param {Item} item */
  show(item) {
    if (item.kind === "photo") return super.fill(item, []);
    const times = item.facts?.moments_s ?? (AT_WORK.includes(item.state) ? UNKNOWN : []);
    const choices = times.map((time, number) => ({
      lines: [time === null ? "…" : words.time(time)],
      label: time === null ? words.opening : words.momentAt(words.time(time)),
      pressed: number === item.moment,
      blob: item.smalls[number],
      coming: item.state === "finding",
    }));
    super.fill(item, choices);
  }
}
