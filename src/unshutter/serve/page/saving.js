// Photos saved: one as a download, many as a zip file or into the folder of `--folder`.

import { ask, download, events } from "./api.js";
import { by } from "./nodes.js";
import { words } from "./words.js";

export async function saveOne(photo, notice) {
  try {
    await download(await photo.ask("picture"));
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

// Saves many; folder: its name for to = "folder".
export async function saveMany(photos, to, folder, notice) {
  const wanted = photos.filter((photo) => photo.id !== null && photo.state !== "failed");
  if (!wanted.length) return notice(words.nothingToSave);
  const [box, bar, stop] = [by("saving"), by("saving-bar"), by("saving-stop")];
  try {
    const asked = await Promise.all(wanted.map(async (photo) => ({ id: photo.id, options: await photo.asked() })));
    const body = JSON.stringify({ to, photos: asked });
    let saving = await (await ask("/api/saves", { method: "POST", body })).json();
    stop.onclick = () => ask(`/api/saves/${saving.id}`, { method: "DELETE" });
    box.hidden = false;
    for await (saving of events(`/api/saves/${saving.id}/events`)) {
      by("saving-words").textContent = words.saving(saving.done.length, saving.total);
      Object.assign(bar, { max: saving.total, value: saving.done.length });
    }
    await ended(saving, to === "folder" ? folder : "", notice);
  } catch (error) {
    notice(error.message);
  } finally {
    box.hidden = true;
  }
}

async function ended(saving, folder, notice) {
  const failed = saving.done.filter((each) => each.error);
  const count = saving.done.length - failed.length;
  if (saving.state === "cancelled") return notice(words.cancelled(count, folder));
  if (saving.state !== "finished") return notice(saving.error);
  if (!folder && count) {
    by("saving-words").textContent = words.packing;
    await download(await ask(`/api/saves/${saving.id}/zip`));
  }
  notice(words.saved(count, failed, folder));
}
