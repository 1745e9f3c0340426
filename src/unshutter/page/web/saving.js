// Photos and clips saved: one as a download, many as a zip file.

/** @import { Doing, Item, Notice, Progress, Saving } from "./types.js" @import { Photo } from "./photo.js" */

import { ask, close, download, events, factsIn, lineOf } from "./api.js";
import { element } from "./nodes.js";
import { WRONG } from "./states.js";
import { button } from "./widgets.js";
import { words } from "./words.js";

const bar = () => /** @type {HTMLProgressElement} */ (element("saving-bar"));
const stop = button("stopSaving", () => {});
element("saving").append(stop);

/** @param {unknown} error */
export const messageOf = (error) => (error instanceof Error ? error.message : String(error));

/** @param {Item} item @param {Notice} notice */
export async function saveOne(item, notice) {
  if (item.kind === "clip") return saveMany([item], "file", notice); // that takes long
  try {
    const wishes = item.wishes;
    const answer = await item.ask("picture");
    notice(words.savedOne(await download(answer), factsIn(answer)?.left_out ?? []));
    item.keep(wishes);
  } catch (error) {
    notice(words.error(item.name, messageOf(error)));
  }
}

/** @param {Photo} photo @param {Notice} notice */
export async function saveMotion(photo, notice) {
  try {
    await download(await photo.ask("motion"));
  } catch (error) {
    notice(words.error(photo.name, messageOf(error)));
  }
}

/** @param {Item} item */
const canBeSaved = ({ state }) => !WRONG.includes(state);

/**
 * Saves all as a zip file; if some are left unchanged, or may be, the user chooses whether they are wanted, too.
 * @param {Item[]} items @param {Notice} notice
 */
export async function saveAll(items, notice) {
  const savable = items.filter(canBeSaved);
  const done = savable.filter(({ state }) => state === "done");
  const changed = done.filter(({ result }) => result?.changed).length;
  const none = !changed && done.length === savable.length && savable.every(({ kind }) => kind === "photo");
  const which = changed < savable.length ? await choice(changed, savable.length, none) : "all";
  if (which) await saveMany(savable, "zip", notice, which === "changed");
}

/** @param {number} changed @param {number} total @param {boolean} none is straightened @returns {Promise<string>} */
function choice(changed, total, none) {
  const dialog = /** @type {HTMLDialogElement} */ (element("save-which"));
  element("save-which-words").textContent = words.saveWhich(changed, total);
  dialog.returnValue = ""; // which Escape leaves
  element("save-changed").hidden = none;
  dialog.showModal();
  /** @type {HTMLElement | null} */ (dialog.querySelector("button:not([hidden])"))?.focus();
  return new Promise((chosen) => dialog.addEventListener("close", () => chosen(dialog.returnValue), { once: true }));
}

/** @param {Item[]} items @param {"file" | "zip"} to @param {Notice} notice */
async function saveMany(items, to, notice, onlyChanged = false) {
  const savable = items.filter(canBeSaved);
  if (!savable.length) return notice(words.nothingToSave);
  /** @type {Saving | null} */
  let saving = null;
  const leave = () => saving && close("/api/saves", saving.id); // nobody will fetch it
  addEventListener("pagehide", leave);
  try {
    const wishes = savable.map((item) => item.wishes);
    const asked = savable.map(async (item) => ({ id: await item.sendAhead(), options: await item.asked() }));
    const body = JSON.stringify({ to, photos: await Promise.all(asked), only_changed: onlyChanged });
    const begun = /** @type {Saving} */ (await (await ask("/api/saves", { method: "POST", body })).json());
    saving = begun;
    let stopped = false;
    stop.onclick = () => {
      stopped = true;
      ask(`/api/saves/${begun.id}`, { method: "DELETE" });
    };
    element("saving").hidden = false;
    for await (const now of events(`/api/saves/${begun.id}/events`)) show((saving = /** @type {Saving} */ (now)));
    if (stopped) saving.state = "cancelled"; // even if it was just finished: its files are gone
    await ended(saving, notice);
    const { done } = saving;
    savable.forEach((item, k) => done[k]?.result && item.keep(wishes[k]));
  } catch (error) {
    notice(messageOf(error));
  } finally {
    element("saving").hidden = true;
    removeEventListener("pagehide", leave);
    leave();
  }
}

/** How much of a clip's work is done, and how long the rest takes. @param {Progress | null} now @returns {Doing} */
export const doing = (now) => ({ share: now?.share ?? 0, left: now?.left_s ? words.left(now.left_s) : "" });

/** Shows how many are done, of a clip at work how many frames, and how long that still takes. @param {Saving} saving */
function show({ done, total, now }) {
  const { share, left } = doing(now);
  const many = total > 1 || !now ? words.saving(done.length, total) : "";
  element("saving-words").textContent = [many, now ? making(now) : "", left].filter(Boolean).join(" · ");
  if (done.length + share) bar().value = (done.length + share) / total;
  else bar().removeAttribute("value"); // nobody knows yet
}

/** @param {NonNullable<Saving["now"]>} now */
function making(now) {
  const stage = /** @type {Record<string, string>} */ (words.makingOf)[now.what];
  return words.error(now.name, words.making(now, stage));
}

/** @param {Saving} saving @param {Notice} notice */
async function ended({ id, to, state, error = "", total, done }, notice) {
  const failed = done.filter((each) => each.error);
  const count = done.filter((each) => each.result).length;
  if (state === "cancelled") return notice(words.cancelled);
  if (state !== "finished") return notice(error);
  if (count) {
    element("saving-words").textContent = words.fetching;
    await download(await ask(`/api/saves/${id}/file`));
  }
  const [{ name, declined = [], frames }] = done;
  if (!count && !failed.length) {
    return notice(to === "file" && declined.length ? words.clipUnchanged(name, declined[0]) : words.noneChanged);
  }
  const why = failed.map((each) => `${each.name} (${lineOf(each)})`).join(", ");
  const isClip = total === 1 && count === 1 && frames !== undefined;
  const lost = [...new Set(done.flatMap((each) => each.left_out ?? []))]; // of photos
  if (isClip) notice(words.clipSaved(done[0]), (done[0].parts ?? []).map(words.part).join("\n"));
  else notice(words.savedMany(count, why, lost));
}
