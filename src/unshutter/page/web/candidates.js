// What the row under the picture offers of a photo: the photo as it is, and what else it could be.

import { PictureRow } from "./picture_row.js";
import { LEAST_PX, words } from "./words.js";

export class Candidates extends PictureRow {
  #numbers = []; // of the candidates, from 1, as they are shown

  // node: where to; take(number): called with the number of a candidate, from 1.
  constructor(node, take) {
    super(node, (index) => take(this.#numbers[index]));
  }

  // Shows those of a photo, unless they say nothing there; of a clip, none.
  show(photo) {
    const candidates = photo.kind === "photo" && photo.state !== "failed" && !photo.between ? photo.candidates : [];
    const numbered = candidates
      .map((candidate, index) => ({ ...candidate, number: index + 1 }))
      .filter(({ kind, largest_px: px }) => kind === "still" || px >= LEAST_PX);
    const still = (one) => (one.kind === "still" ? 0 : 1);
    const listed = numbered.length > 1 ? numbered.sort((one, other) => still(one) - still(other)) : [];
    const likeliest = photo.options?.moving ? null : Math.max(...listed.map(({ probability }) => probability ?? 0));
    this.#numbers = listed.map(({ number }) => number);
    super.show(
      photo,
      listed.map((candidate) => {
        const [name, figures] = [words.candidate(candidate), words.candidateFigures(candidate, likeliest)];
        return {
          lines: [name, figures],
          title: words.candidateHelp(candidate),
          pressed: candidate.number === photo.candidate,
          blob: candidate.blob,
          crop: candidate.crop,
          chance: likeliest === null ? null : candidate.probability,
        };
      }),
    );
  }

  // Takes one that is shown, from 0.
  pickShown(index) {
    if (index < this.#numbers.length) this.pick(index);
  }
}
