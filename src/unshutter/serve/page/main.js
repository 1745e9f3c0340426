// The page: photos and clips come in, one of them is shown, and what the user says goes to the program.

import { Advice } from "./advice.js";
import { about, onHealth } from "./api.js";
import { Clip, isClip } from "./clip.js";
import { ClipControls } from "./clip_controls.js";
import { Controls, shared } from "./controls.js";
import { watch } from "./incoming.js";
import { Lines } from "./lines.js";
import { Moments } from "./moments.js";
import { by } from "./nodes.js";
import { Photo } from "./photo.js";
import { saveMany, saveMotion, saveOne } from "./saving.js";
import { Stage } from "./stage.js";
import { stateOf, Strip } from "./strip.js";
import { fill, words } from "./words.js";

const SIDES = [1000, 1600, 2400]; // longer sides of copies for screens [px], as the program makes them
const AT_ONCE = 2; // photos that are worked on in the background
const ZOOM_REST_MS = 250;

const photos = [];
let current = null;
let settings = { max_bytes: Infinity, max_clip_bytes: Infinity, folder: null, clips: true };
let background = 0;

fill(document);
const stage = new Stage(by("stage"), { zoom: zoomed });
const strip = new Strip(by("thumbnails"), { pick: show, close });
const lines = new Lines(stage, () => {
  controls.show(current);
  refresh();
});
const controls = new Controls(by("panel"), lines, {
  change: () => refresh(),
  draft,
  tool: drawing,
  lines: toggleLines,
  save: () => saveOne(current, notice),
  saveMotion: () => saveMotion(current, notice),
  toAll,
});
const advice = new Advice(by("advice"), {
  moving: () => change("moving", "true"),
  anyway: () => change("min-confidence", "0"),
  neighbour: () => controls.neighbours.open(),
  byHand: () => controls.hand.open(),
  leaveNeighbours: () => controls.neighbours.clear(),
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
  by("viewer").hidden = !photos.length;
  by("strip").hidden = photos.length < 2;
  for (const id of ["previous", "next"]) by(id).hidden = photos.length < 2;
  for (const [id, kind] of [["panel", "photo"], ["clip-panel", "clip"]]) {
    by(id).hidden = current?.kind !== kind || (kind === "photo" && current.state === "failed");
  }
  by("save-all").hidden = photos.length < 2;
  for (const panel of [controls, clipControls]) panel.toAll.hidden = photos.length < 2;
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
  stage.clear();
  linesShown = false;
  controls.hand.stop();
  strip.select(photo);
  arrange();
  by("name").textContent = photo.name;
  update();
  refresh("both");
}

// What is known of the current photo goes to the screen.
function update() {
  const { facts, pictures, result, state } = current;
  for (const [which, alt] of [["before", words.beforeAlt], ["after", words.afterAlt]]) {
    const picture = pictures[which];
    if (!picture || !facts || shown[which] === picture.blob) continue;
    shown[which] = picture.blob;
    stage.picture(which, picture.blob, facts, alt(current.name));
    if (which === "before" && !pictures.after) stage.picture("after", picture.blob, facts, "");
  }
  stage.crop(result?.crop ?? null);
  stage.single = current.kind === "photo" && !(state === "done" && result?.changed) && !(result?.changed && state === "finding");
  panelOf(current).show(current);
  advise();
  moments.show(current.kind === "clip" ? current : null);
  const failed = ["failed", "asking"].includes(state);
  const inPicture = failed && !pictures.before; // then the error is said where the picture would be
  if (inPicture) stage.say(words.sentence(current.error));
  if (current.kind === "photo") by("panel").hidden = state === "failed";
  by("working").textContent = state === "done" || inPicture ? "" : failed ? current.error : stateOf(current);
  by("working").classList.toggle("wrong", failed);
}

function longest() {
  return SIDES.find((side) => side >= stage.longest) ?? (stage.zoomed ? "full" : SIDES[SIDES.length - 1]);
}

let resizing = null;

// Another zoom: once it rests, pictures of that size are asked for.
function zoomed() {
  by("zoom").setAttribute("aria-pressed", stage.zoomed);
  clearTimeout(resizing);
  resizing = setTimeout(() => current?.pictures.before && larger(longest(), current.pictures.before.longest) && refresh("both"), ZOOM_REST_MS);
}

const larger = (one, other) => other !== "full" && (one === "full" || one > other);

let drafting = false;
let draftAgain = false;

// What a slider that is being dragged does: quick pictures, one after the other, the last one as it rests.
async function draft() {
  draftAgain = true;
  if (drafting) return;
  drafting = true;
  const photo = current;
  while (draftAgain && photo === current) {
    draftAgain = false;
    const after = photo.pictures.after;
    try {
      const blob = await photo.draft(SIDES[0]);
      if (photo !== current || photo.pictures.after !== after) continue;
      stage.single = false;
      stage.crop(null);
      stage.picture("after", blob, photo.facts, words.afterAlt(photo.name));
      shown.after = null; // the whole answer is to take its place
    } catch {
      // the whole answer says what is wrong
    }
  }
  drafting = false;
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
  const size = longest();
  const whole = part === "both" || photo.pictures.before?.longest !== size;
  if (size === "full") by("working").textContent = words.drawing;
  await photo.show(size, false, whole ? "both" : "after");
  if (asking === photo) asking = null;
  if (photo !== current) return;
  if (linesShown) showLines();
  if (again) {
    const next = again;
    again = null;
    refresh(next);
  }
}

// ---- what the user says ----

function change(name, value) {
  current.set(name, value);
  refresh();
}

// While lines are drawn there is no advice: the picture must not move under the pointer when an answer comes.
function advise() {
  advice.show(lines.kind === null ? current : null);
}

// A tool draws lines: they are drawn on the photo as it was taken, and snap to its segments.
async function drawing(kind) {
  const photo = current;
  advise();
  if (!kind || !photo) return;
  try {
    lines.segments = (await (await photo.ask("segments")).json()).before;
  } catch {
    lines.segments = []; // lines are drawn as well without
  }
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

let linesShown = false;

async function showLines() {
  const photo = current;
  try {
    const segments = await (await photo.ask("segments")).json();
    if (photo === current && linesShown) stage.segments(segments);
  } catch (error) {
    notice(words.error(photo.name, error.message));
  }
}

function toggleLines() {
  if (current.kind === "clip") return;
  linesShown = !linesShown;
  if (linesShown) showLines();
  else stage.segments(null);
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else by("viewer").requestFullscreen?.().catch(() => {});
}

function original(on) {
  stage.original = on || lines.kind !== null;
}

async function sample() {
  const answer = await fetch("/page/sample.jpg");
  take([new File([await answer.blob()], "sample.jpg", { type: "image/jpeg" })]);
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
  j: () => step(1), k: () => step(-1), z: () => stage.toggleZoom(), l: toggleLines, f: fullScreen, o: () => original(true),
  "+": stage.zoomIn, "=": stage.zoomIn, "-": stage.zoomOut, "0": () => stage.whole(),
  s: () => panelOf(current).save.disabled || saveOne(current, notice), escape: () => controls.hand.stop() };
addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input:not([type=checkbox],[type=radio],[type=range]), select, textarea");
  if (!current || typing || event.ctrlKey || event.metaKey || event.altKey || !(event.key.toLowerCase() in keys)) return;
  event.preventDefault();
  keys[event.key.toLowerCase()]();
});
addEventListener("keyup", (event) => event.key.toLowerCase() === "o" && original(false));
const clicks = { previous: () => step(-1), next: () => step(1), close: () => close(current), zoom: () => stage.toggleZoom(),
  "zoom-in": stage.zoomIn, "zoom-out": stage.zoomOut, "full-screen": fullScreen, sample };
for (const [id, clicked] of Object.entries(clicks)) by(id).addEventListener("click", clicked);
by("drop-area").addEventListener("click", (event) => !event.target.closest("#sample") && by("choose").click());
for (const name of ["pointerdown", "pointerup", "pointercancel", "pointerleave"]) {
  by("original").addEventListener(name, () => original(name === "pointerdown"));
}
by("zoom").title = words.zoomHelp;
by("original").title = words.originalHelp;
by("save-all").addEventListener("click", () => saveMany(photos, "zip", "", notice));
by("save-folder").addEventListener("click", () => saveMany(photos, "folder", settings.folder, notice));
addEventListener("beforeunload", (event) => photos.some((photo) => photo.unsaved) && event.preventDefault());
addEventListener("pagehide", () => photos.forEach((photo) => photo.forget()));
watch(take);

about().then((answer) => {
  settings = answer;
  arrange();
}).catch(() => {}); // onHealth has said it
