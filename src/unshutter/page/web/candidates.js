// What the row under the picture offers of a photo: the photo as it is, and what else it could be.

/** @import { Candidate, Item } from "./types.js" */

import { PictureRow } from "./picture_row.js";
import { words } from "./words.js";

export class Candidates extends PictureRow {
  /** @type {number[]} of the candidates, from 1, as they are shown */
  #numbers = [];

  /**
   * @param {HTMLElement} node where to
   * @param {(number: number) => void} take called with the number of a candidate, from 1
   */
  constructor(node, take) {
    super(node, (index) => take(this.#numbers[index]));
  }

  /** Shows those of a photo, unless they say nothing there; of a clip, none. @param {Item} item */
  show(item) {
    if (item.kind === "clip" || item.state === "failed" || item.between) return super.fill(item, []);
    const numbered = item.candidates.map((candidate, index) => ({ ...candidate, number: index + 1 }));
    const seen = numbered.filter(({ visible }) => visible);
    const moving = (/** @type {Candidate} */ one) => Number(one.kind !== "still");
    const listed = seen.length > 1 ? seen.sort((one, other) => moving(one) - moving(other)) : [];
    const likeliest = item.options.moving ? null : Math.max(...listed.map(({ probability }) => probability ?? 0));
    this.#numbers = listed.map(({ number }) => number);
    const choices = listed.map((candidate) => ({
      lines: [nameOf(candidate), words.candidateFigures(candidate, likeliest)],
      title: words.candidateHelp(candidate),
      pressed: candidate.number === item.candidate,
      blob: candidate.blob,
      crop: candidate.crop,
      chance: likeliest === null ? null : candidate.probability,
    }));
    super.fill(item, choices);
  }

  /** Takes one that is shown, from 0. @param {number} index */
  pickShown(index) {
    if (index < this.#numbers.length) this.pick(index);
  }
}

/** @param {Candidate} candidate */
const nameOf = ({ kind, direction }) => (kind === "pan" ? words.pan[direction ?? "left"] : words.candidate[kind]);
