// What the row under the picture offers of a clip: its moments.

/** @import { Item } from "./types.js" */

import { PictureRow } from "./picture_row.js";
import { words } from "./words.js";

export class Moments extends PictureRow {
  /** Shows those of a clip; of a photo, none. @param {Item} item */
  show(item) {
    if (item.kind === "photo") return super.fill(item, []);
    const choices = (item.facts?.moments_s ?? []).map((time, number) => ({
      lines: [words.time(time)],
      label: words.momentAt(words.time(time)),
      pressed: number === item.moment,
      blob: item.smalls[number],
      coming: item.state === "finding",
    }));
    super.fill(item, choices);
  }
}
