// Photos and clips saved: one as a download, many as a zip file.

import { ask, close, download, events, lineOf } from "./api.js";
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
  const none = !changed && savable.every(({ state, kind }) => state === "done" && kind === "photo");
  const which = changed < savable.length ? await choice(changed, savable.length, none) : "all";
  if (which) await saveMany(savable, "zip", notice, which === "changed");
}

function choice(changed, total, none) {
  const dialog = by("save-which");
  by("save-which-words").textContent = words.saveWhich(changed, total);
  dialog.returnValue = ""; // which Escape leaves
  by("save-changed").hidden = none;
  dialog.showModal();
  dialog.querySelector("button:not([hidden])").focus();
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

// Stages of work on a clip -> seconds a step, and how many steps are usual before they are counted.
const STEPS = {
  gyro: [0.5, 12],
  "readout time": [0.01, 500],
  looking: [0.03, 300],
  film: [0.02, 240],
  frames: [0.03, 300],
};

// Says of what the program notes how much of the work on a clip is done, and how long the rest takes: one share from start to
// end, which never falls, though the stages are many. goal: the last of them.
export function pace(goal) {
  let [share, past, last, began] = [0, 0, null, null];
  const cost = (what, total = STEPS[what][1]) => STEPS[what][0] * total;
  return (now) => {
    if (!(now?.what in STEPS) || !now.total) return { share, left: "" };
    if (last && (last.what !== now.what || now.done < last.done)) past += cost(last.what, last.total);
    last = now;
    const own = cost(now.what, now.total);
    const coming =
      now.what === goal ? 0 : now.what === "looking" ? own : cost(goal) + (goal === "frames" ? cost("looking") : 0);
    share = Math.max(share, (past + own * Math.min(now.done / now.total, 1)) / (past + own + coming));
    began ??= [performance.now() / 1000, share];
    const [elapsed, done] = [performance.now() / 1000 - began[0], share - began[1]];
    return { share, left: elapsed > 2 && done > 0.02 ? words.left((elapsed * (1 - share)) / done) : "" };
  };
}

// Shows how many are done, of a clip at work how many frames, and how long that still takes.
function watch() {
  let [files, own] = [0, pace("frames")];
  return ({ done, total, now }) => {
    if (done.length !== files) [files, own] = [done.length, pace("frames")];
    const { share, left } = own(now);
    by("saving-words").textContent = [
      total > 1 || !now ? words.saving(files, total) : "",
      now ? words.making(now) : "",
      left,
    ]
      .filter(Boolean)
      .join(" · ");
    if (files + share) by("saving-bar").value = (files + share) / total;
    else by("saving-bar").removeAttribute("value"); // nobody knows yet
  };
}

async function ended(saving, notice) {
  const failed = saving.done.filter((each) => each.error).map((each) => ({ ...each, error: lineOf(each) }));
  const count = saving.done.filter((each) => each.result).length;
  if (saving.state === "cancelled") return notice(words.cancelled);
  if (saving.state !== "finished") return notice(saving.error);
  if (count) {
    by("saving-words").textContent = words.fetching;
    await download(await ask(`/api/saves/${saving.id}/file`));
  }
  const clip = saving.total === 1 && count === 1 && saving.done[0].frames !== undefined;
  const [{ name, declined }] = saving.done;
  if (!count && !failed.length)
    return notice(
      saving.to === "file" && declined?.length ? words.clipUnchanged(name, words.why(declined[0])) : words.noneChanged,
    );
  notice(clip ? words.clipSaved(saving.done[0]) : words.saved(count, failed));
}
