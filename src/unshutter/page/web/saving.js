// Photos and clips saved: one as a download, many as a zip file.

import { ask, close, download, events } from "./api.js";
import { by } from "./nodes.js";
import { words } from "./words.js";

export async function saveOne(photo, notice) {
  if (photo.kind === "clip") return saveMany([photo], "file", notice); // that takes long
  try {
    const wishes = photo.wishes;
    notice(words.savedOne(await download(await photo.ask("picture"))));
    photo.keep(wishes);
  } catch (error) {
    notice(words.error(photo.name, error.message));
  }
}

export async function saveMotion(photo, notice) {
  try {
    await download(await photo.ask("motion"));
  } catch (error) {
    notice(words.error(photo.name, error.message));
  }
}

const canBeSaved = (photo) => photo.id !== null && !["failed", "asking"].includes(photo.state);

// Saves all as a zip file; if some are left unchanged, or may be, the user chooses whether they are wanted, too.
export async function saveAll(photos, notice) {
  const savable = photos.filter(canBeSaved);
  const changed = savable.filter(({ state, result }) => state === "done" && result.changed).length;
  const which = changed < savable.length ? await choice(changed, savable.length) : "all";
  if (which) await saveMany(savable, "zip", notice, which === "changed");
}

function choice(changed, total) {
  const dialog = by("save-which");
  by("save-which-words").textContent = words.saveWhich(changed, total);
  dialog.returnValue = ""; // which Escape leaves
  dialog.showModal();
  by("save-changed").focus();
  return new Promise((done) => dialog.addEventListener("close", () => done(dialog.returnValue), { once: true }));
}

// Saves one or many: to = "file" or "zip".
async function saveMany(photos, to, notice, onlyChanged = false) {
  const savable = photos.filter(canBeSaved);
  if (!savable.length) return notice(words.nothingToSave);
  const [box, stop] = [by("saving"), by("saving-stop")];
  let saving = null;
  const leave = () => saving && close("/api/saves", saving.id); // nobody will fetch it
  addEventListener("pagehide", leave);
  try {
    const wishes = savable.map((photo) => photo.wishes);
    const asked = await Promise.all(savable.map(async (photo) => ({ id: photo.id, options: await photo.asked() })));
    const body = JSON.stringify({ to, photos: asked, only_changed: onlyChanged });
    saving = await (await ask("/api/saves", { method: "POST", body })).json();
    let stopped = false;
    stop.onclick = () => {
      stopped = true;
      ask(`/api/saves/${saving.id}`, { method: "DELETE" });
    };
    box.hidden = false;
    const show = watch();
    for await (saving of events(`/api/saves/${saving.id}/events`)) {
      show(saving);
    }
    if (stopped) saving.state = "cancelled"; // even if it was just finished: its files are gone
    await ended(saving, notice);
    savable.forEach((photo, k) => saving.done[k]?.result && photo.keep(wishes[k]));
  } catch (error) {
    notice(error.message);
  } finally {
    box.hidden = true;
    removeEventListener("pagehide", leave);
    leave();
  }
}

// Shows how many are done, of a clip at work how many frames, and how long it still takes: one bar from start to end.
export function watch() {
  const began = performance.now();
  let passes = 1; // over the frames of a clip: for some options all are looked at first
  return ({ done, total, now }) => {
    if (now?.what === "looking") passes = 2;
    const pass = now?.done && now.what !== "readout time" ? Math.min(now.done / now.total, 1) : 0;
    const share = (done.length + (now?.what === "frames" ? passes - 1 + pass : pass) / passes) / total;
    const elapsed = (performance.now() - began) / 1000;
    const left = share > 0.02 && elapsed > 2 ? words.left((elapsed * (1 - share)) / share) : "";
    by("saving-words").textContent = [total > 1 || !now ? words.saving(done.length, total) : "", now ? words.making(now) : "", left].filter(Boolean).join(" · ");
    if (share) by("saving-bar").value = share;
    else by("saving-bar").removeAttribute("value"); // nobody knows yet
  };
}

async function ended(saving, notice) {
  const failed = saving.done.filter((each) => each.error);
  const count = saving.done.filter((each) => each.result).length;
  if (saving.state === "cancelled") return notice(words.cancelled);
  if (saving.state !== "finished") return notice(saving.error);
  if (count) {
    by("saving-words").textContent = words.fetching;
    await download(await ask(`/api/saves/${saving.id}/file`));
  }
  const clip = saving.total === 1 && count === 1 && saving.done[0].frames !== undefined;
  if (!count && !failed.length) return notice(words.noneChanged);
  notice(clip ? words.clipSaved(saving.done[0]) : words.saved(count, failed));
}
