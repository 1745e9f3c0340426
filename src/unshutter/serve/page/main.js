// The page: photos and clips come in, one of them is shown, and what the user says goes to the program.

import { about, onHealth } from "./api.js";
import { Clip, isClip } from "./clip.js";
import { ClipControls } from "./clip_controls.js";
import { Controls, shared } from "./controls.js";
import { attitude, Horizon } from "./horizon.js";
import { watch } from "./incoming.js";
import { Moments } from "./moments.js";
import { by } from "./nodes.js";
import { Photo } from "./photo.js";
import { saveMany, saveMotion, saveOne } from "./saving.js";
import { Slider } from "./slider.js";
import { stateOf, Strip } from "./strip.js";
import { fill, words } from "./words.js";

const SIDES = [1000, 1600, 2400]; // longer sides of copies for screens [px], as the program makes them
const AT_ONCE = 2; // photos that are worked on in the background

const photos = [];
let current = null;
let settings = { max_bytes: Infinity, max_clip_bytes: Infinity, folder: null, clips: true };
let background = 0;

fill(document);
const slider = new Slider(by("stage"));
const strip = new Strip(by("thumbnails"), { pick: show, close });
const horizon = new Horizon(slider.frame, tellLevel);
const controls = new Controls(by("panel"), {
  change: () => refresh(),
  horizon: toggleHorizon,
  horizonTrue: () => current.level && tellLevel(current.level),
  save: () => saveOne(current, notice),
  saveMotion: () => saveMotion(current, notice),
  toAll,
});
const clipControls = new ClipControls(by("clip-panel"), {
  change: () => refresh(current.pictures.before ? "after" : "both"),
  save: () => saveOne(current, notice),
  toAll,
});
const moments = new Moments(by("moments"), pickMoment);
const panelOf = (photo) => (photo.kind === "clip" ? clipControls : controls);

// ---- photos come and go ----

function take(files) {
  for (const file of files) {
    const most = isClip(file) ? settings.max_clip_bytes : settings.max_bytes;
    if (isClip(file) && !settings.clips) notice(words.noClips(file.name));
    else if (file.size > most) notice(words.tooLarge(file.name, most / 1e6));
    else {
      const photo = isClip(file) ? new Clip(file) : new Photo(file);
      photos.push(photo);
      strip.add(photo);
      photo.addEventListener("change", () => photo === current && update());
    }
  }
  if (!current && photos.length) show(photos[0]);
  arrange();
  workInBackground();
}

function close(photo) {
  const place = photos.indexOf(photo);
  photos.splice(place, 1);
  strip.remove(photo);
  photo.forget();
  if (photo === current) {
    current = null;
    if (photos.length) show(photos[Math.min(place, photos.length - 1)]);
  }
  arrange();
}

function arrange() {
  by("empty").hidden = photos.length > 0;
  for (const id of ["viewer", "strip"]) by(id).hidden = !photos.length;
  for (const [id, kind] of [["panel", "photo"], ["clip-panel", "clip"]]) by(id).hidden = current?.kind !== kind;
  by("save-all").hidden = photos.length < 2;
  by("save-folder").hidden = !photos.length || settings.folder === null;
}

// Photos that nobody looks at get their thumbnails and motions, a few at a time.
async function workInBackground() {
  while (background < AT_ONCE) {
    const photo = photos.find((each) => each.state === "waiting" && each !== current);
    if (!photo) return;
    background += 1;
    photo.small(true).catch(() => {}).finally(() => {
      background -= 1;
      workInBackground();
    });
    await null;
  }
}

// ---- one of them is shown ----

let shown = {}; // the blobs that are on the stage

function show(photo) {
  current = photo;
  shown = {};
  slider.clear();
  horizon.hide();
  controls.horizonShown = false;
  press("lines", false);
  by("lines").hidden = photo.kind === "clip";
  strip.select(photo);
  arrange();
  by("name").textContent = photo.name;
  update();
  refresh("both");
}

// What is known of the current photo goes to the screen.
function update() {
  const { facts, pictures, result } = current;
  for (const [which, alt] of [["before", words.beforeAlt], ["after", words.afterAlt]]) {
    const picture = pictures[which];
    if (!picture || !facts || shown[which] === picture.blob) continue;
    shown[which] = picture.blob;
    slider.picture(which, picture.blob, facts, alt(current.name));
    if (which === "before" && !pictures.after) slider.picture("after", picture.blob, facts, "");
  }
  slider.crop(result?.crop ?? null);
  panelOf(current).show(current);
  moments.show(current.kind === "clip" ? current : null);
  const failed = ["failed", "asking"].includes(current.state);
  by("working").textContent = current.state === "done" ? "" : failed ? current.error : stateOf(current);
  by("working").classList.toggle("wrong", failed);
}

function longest() {
  return SIDES.find((side) => side >= slider.longest) ?? SIDES[SIDES.length - 1];
}

let asking = null; // the photo that is asked for, and whether it has been changed meanwhile
let again = null;

// Asks for the current photo as its options are now; while an answer is on its way, only the last wish counts.
async function refresh(part) {
  const photo = current;
  panelOf(photo).show(photo);
  if (asking === photo) {
    again = again === "both" ? "both" : part ?? "after";
    return;
  }
  asking = photo;
  const size = slider.zoomed ? "full" : longest();
  const whole = part === "both" || photo.pictures.before?.longest !== size;
  if (slider.zoomed) by("working").textContent = words.drawing;
  await photo.show(size, false, whole ? "both" : "after");
  if (asking === photo) asking = null;
  if (photo !== current) return;
  if (by("lines").getAttribute("aria-pressed") === "true") showLines();
  if (again) {
    const next = again;
    again = null;
    refresh(next);
  }
}

// ---- what the user says ----

function toggleHorizon() {
  if (horizon.shown) horizon.hide();
  else horizon.show(current.level);
  controls.horizonShown = horizon.shown;
}

function tellLevel(ends) {
  current.level = ends.map((end) => [...end]);
  const held = attitude(ends, current.facts, controls.isTrueHorizon);
  controls.horizonSteep = held === null;
  if (held === null) return;
  current.set("roll-deg", held.roll.toFixed(2));
  if (held.tilt !== null) current.set("tilt-deg", held.tilt.toFixed(2));
  refresh();
}

function pickMoment(number) {
  if (number >= (current.facts?.moments_s.length ?? 0)) return;
  current.goTo(number);
  refresh("both");
}

function toAll() {
  for (const photo of photos) {
    if (photo === current || photo.kind !== current.kind) continue;
    photo.options = shared(current.options, photo.options);
    if (photo.state !== "failed") photo.state = "waiting";
    strip.update(photo);
  }
  notice(current.kind === "clip" ? words.clipToAllDone : words.toAllDone);
  workInBackground();
}

function press(id, on) {
  by(id).setAttribute("aria-pressed", on);
}

async function showLines() {
  const photo = current;
  try {
    const lines = await (await photo.ask("segments")).json();
    if (photo === current && by("lines").getAttribute("aria-pressed") === "true") slider.segments(lines);
  } catch (error) {
    notice(words.error(photo.name, error.message));
  }
}

function toggleLines() {
  if (by("lines").hidden) return;
  const on = by("lines").getAttribute("aria-pressed") !== "true";
  press("lines", on);
  if (on) showLines();
  else slider.segments(null);
}

function toggleZoom() {
  slider.zoomed = !slider.zoomed;
  press("zoom", slider.zoomed);
  refresh("both");
}

function step(by) {
  const next = photos[photos.indexOf(current) + by];
  if (next) show(next);
}

// ---- the page itself ----

let lasting = null;

function notice(line) {
  by("notice").textContent = line;
  by("notice").hidden = !line;
  clearTimeout(lasting);
  if (line) lasting = setTimeout(() => notice(""), 12000);
}

onHealth((health) => {
  const line = { gone: words.gone, "old link": words.oldLink }[health];
  if (line) notice(line);
  else if ([words.gone, words.oldLink].includes(by("notice").textContent)) notice("");
});

const keys = { ...Object.fromEntries([1, 2, 3, 4, 5].map((k) => [k, () => current.kind === "clip" && pickMoment(k - 1)])),
  j: () => step(1), k: () => step(-1), z: toggleZoom, l: toggleLines, s: () => saveOne(current, notice) };
addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input:not([type=checkbox],[type=radio],[type=range]), select, textarea");
  if (!current || typing || event.ctrlKey || event.metaKey || event.altKey || !(event.key.toLowerCase() in keys)) return;
  event.preventDefault();
  keys[event.key.toLowerCase()]();
});
by("previous").addEventListener("click", () => step(-1));
by("next").addEventListener("click", () => step(1));
by("lines").addEventListener("click", toggleLines);
by("zoom").addEventListener("click", toggleZoom);
by("lines").title = words.linesHelp;
by("zoom").title = words.zoomHelp;
by("save-all").addEventListener("click", () => saveMany(photos, "zip", "", notice));
by("save-folder").addEventListener("click", () => saveMany(photos, "folder", settings.folder, notice));
addEventListener("pagehide", () => photos.forEach((photo) => photo.forget()));
watch(take);

about().then((answer) => {
  settings = answer;
  arrange();
}).catch(() => {}); // onHealth has said it
