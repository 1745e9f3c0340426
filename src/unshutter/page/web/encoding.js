// How a clip is encoded: lists of what this machine can write, by what the program says of its encoders.

/** @import { Encoders, Options } from "./types.js" @import { Form } from "./form.js" */

import { make, refill } from "./nodes.js";
import { words } from "./words.js";

/** Options whose lists depend on the clip. */
export const ENCODING = ["codec", "crf", "preset"];

/**
 * Fills the lists for a clip; what was asked for is in them, whatever the encoder.
 * @param {Form} form @param {Encoders} encoders @param {Options} options
 */
export function showEncoders(form, { own, keeps_rate: keepsRate, usual, described }, options) {
  const { codec = "" } = options;
  const { presets = [], crf: [lossless, smaller] = [] } = described[codec || own] ?? {};
  const { asClip, best, small } = words.qualityOf;
  /** @type {[string, string][]} */
  const qualities = [["", lossless ? best : asClip]];
  if (smaller) qualities.push([String(smaller), small]);
  const named = /** @type {Record<string, string>} */ (words.encoderOf);
  /** @type {Record<string, [string, string][]>} */
  const lists = {
    codec: [["", words.ownCodec], ...usual.map((name) => pair(name, named[name]))],
    crf: qualities,
    preset: [["", words.usual], ...presets.map((name) => pair(name))],
  };
  for (const [name, list] of Object.entries(lists)) {
    const asked = options[name] ?? "";
    const all = list.some(([value]) => value === asked) ? list : [...list, pair(asked)];
    const field = form.field(name);
    refill(
      field,
      all.map(([value, text]) => make("option", { value }, text)),
    );
    field.value = asked;
    field.disabled = all.length === 1;
  }
  form.field("bitrate").disabled = !keepsRate || (codec || own) !== own;
}

/** @param {string} value @returns {[string, string]} */
const pair = (value, text = value) => [value, text];
