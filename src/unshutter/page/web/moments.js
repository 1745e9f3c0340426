// What the row under the picture offers of a clip: its moments.

import { PictureRow } from "./picture_row.js";
import { words } from "./words.js";

export class Moments extends PictureRow {
  // Shows those of a clip; of a photo, none.
  show(clip) {
    const times = clip.kind === "clip" ? (clip.facts?.moments_s ?? []) : [];
    super.show(
      clip,
      times.map((time, number) => ({
        lines: [words.time(time)],
        label: words.momentAt(words.time(time)),
        pressed: number === clip.moment,
        blob: clip.smalls[number],
        coming: clip.state === "finding",
      })),
    );
  }
}
