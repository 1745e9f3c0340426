// Photos that look like a burst, as the program says of those that are open: they can show one another's motion.

/** @import { Item } from "./types.js" */

import { ask, Refused } from "./api.js";
import { AT_WORK } from "./states.js";

let asked = "";

/**
 * Asks which photos look like a burst, once all are looked at; each of them knows the others then.
 * @param {Item[]} items
 */
export async function findBursts(items) {
  const photos = items.flatMap((item) => (item.kind === "photo" ? [item] : []));
  const open = photos.filter(({ id, state }) => id !== null && state === "done");
  const ids = open.map(({ id }) => id);
  const key = ids.join();
  if (key === asked || items.some(({ state }) => AT_WORK.includes(state))) return;
  asked = key;
  for (const photo of photos) photo.burst = [];
  if (open.length < 2) return;
  try {
    const answer = await ask("/api/bursts", { method: "POST", body: JSON.stringify({ photos: ids }) });
    /** @type {string[][]} */
    const found = await answer.json();
    if (key !== asked) return; // others came or went meanwhile
    for (const burst of found.map((each) => each.map((id) => open[ids.indexOf(id)]))) {
      for (const photo of burst) {
        photo.burst = burst;
        photo.tell();
      }
    }
  } catch (error) {
    if (!(error instanceof Refused)) throw error; // an offer less
  }
}
