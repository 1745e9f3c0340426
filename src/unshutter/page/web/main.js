// The page: photos and clips come in, one of them is looked at, others wait in the strip.

import { about, onHealth } from "./api.js";
import { Clip, isClip } from "./clip.js";
import { shared } from "./controls.js";
import { watch } from "./incoming.js";
import { by, fill, make } from "./nodes.js";
import { Photo } from "./photo.js";
import { saveAll } from "./saving.js";
import { Strip } from "./strip.js";
import { View } from "./view.js";
import { words } from "./words.js";

const AT_ONCE = 2; // photos that are worked on in the background
const NOTICE_MS = 12000;

const photos = [];
let settings = { max_bytes: Infinity, max_clip_bytes: Infinity, clips: true };
let background = 0;

fill(document, words);
const strip = new Strip(by("thumbnails"), by("strip-bar"), { pick: show, close, filtered });
const view = new View({ notice, toAll });

// ---- photos come and go ----

function take(files) {
  let first = null; // of those that have come, which is shown
  for (const file of files) {
    const most = isClip(file) ? settings.max_clip_bytes : settings.max_bytes;
    if (isClip(file) && !settings.clips) notice(words.noClips(file.name, settings.install_clips));
    else if (file.size > most) notice(words.tooLarge(file.name, most / 1e6));
    else {
      const photo = isClip(file) ? new Clip(file) : new Photo(file);
      photos.push(photo);
      first ??= photo;
      strip.add(photo);
      photo.addEventListener("change", () => photo === view.current && view.update());
    }
  }
  if (first) show(first);
  arrange();
  workInBackground();
}

function show(photo) {
  strip.select(photo);
  view.show(photo);
  arrange();
  scrollTo(0, matchMedia("(max-height: 30em)").matches ? by("viewer").offsetTop : 0); // on a phone, the page is longer than the screen
}

function close(photo) {
  const place = photos.indexOf(photo);
  photos.splice(place, 1);
  strip.remove(photo);
  photo.forget();
  if (photo === view.current) {
    view.show(null);
    if (photos.length) show(photos[Math.min(place, photos.length - 1)]);
  }
  arrange();
}

function step(by) {
  const shown = photos.filter((photo) => photo === view.current || strip.shown.includes(photo));
  const next = shown[shown.indexOf(view.current) + by];
  if (next) show(next);
}

// Only those that the filter shows are saved.
function filtered(shown) {
  by("save-all").textContent = shown === photos.length ? words.saveAll : words.saveShown(shown);
}

function arrange() {
  by("empty").hidden = photos.length > 0;
  by("viewer").hidden = !photos.length;
  if (!photos.length) for (const id of ["panel", "clip-panel"]) by(id).hidden = true;
  by("strip").hidden = photos.length < 2;
  for (const id of ["previous", "next"]) by(id).hidden = photos.length < 2;
  by("save-all").hidden = photos.length < 2;
  for (const panel of [view.controls, view.clipControls]) panel.toAll.hidden = photos.length < 2;
}

// Photos that nobody looks at get their thumbnails and motions, a few at a time.
async function workInBackground() {
  while (background < AT_ONCE) {
    const photo = photos.find((each) => each.state === "waiting" && each !== view.current);
    if (!photo) return;
    background += 1;
    photo
      .small(true)
      .catch(() => {})
      .finally(() => {
        background -= 1;
        workInBackground();
      });
    await null;
  }
}

// The others get the options of the current one, but for those that are true of one alone.
function toAll() {
  const { current } = view;
  for (const photo of photos) {
    if (photo === current || photo.kind !== current.kind) continue;
    photo.options = shared(current.options, photo.options);
    if (photo.state !== "failed") photo.state = "waiting";
    strip.update(photo);
  }
  notice(current.kind === "clip" ? words.clipToAllDone : words.toAllDone);
  workInBackground();
}

function toggleGrid() {
  by("grid").setAttribute("aria-pressed", view.stage.toggleGrid());
}

async function sample() {
  const answer = await fetch("/page/sample.jpg");
  take([new File([await answer.blob()], "sample.jpg", { type: "image/jpeg" })]);
}

// ---- what is told ----

let lasting = null;

function notice(line) {
  by("notice").textContent = line;
  by("notice").hidden = !line;
  clearTimeout(lasting);
  if (line) lasting = setTimeout(() => notice(""), NOTICE_MS);
}

onHealth((health) => {
  const line = { gone: words.gone, "old link": words.oldLink }[health];
  if (line) notice(line);
  else if ([words.gone, words.oldLink].includes(by("notice").textContent)) notice("");
});

// ---- keys and buttons ----

const {
  stage,
  controls: { hand },
} = view;
const keys = {
  ...Object.fromEntries([1, 2, 3, 4, 5, 6, 7, 8, 9].map((number) => [number, () => view.pick(number)])),
  j: () => step(1),
  k: () => step(-1),
  z: () => stage.toggleZoom(),
  l: () => view.toggleLines(),
  f: () => view.fullScreen(),
  o: () => view.original(true),
  "+": stage.zoomIn,
  "=": stage.zoomIn,
  "-": stage.zoomOut,
  0: () => stage.whole(),
  s: () => view.save(),
  p: () => view.play(),
  g: toggleGrid,
  escape: () => hand.stop(),
  ...Object.fromEntries(
    [
      ["left", -1],
      ["right", 1],
      ["up", -1],
      ["down", 1],
    ].map(([way, steps]) => [`arrow${way}`, () => hand.nudge(steps)]),
  ),
};
addEventListener("keydown", (event) => {
  const typing = event.target.closest?.("input:not([type=checkbox],[type=radio],[type=range]), select, textarea");
  const key = event.key.toLowerCase();
  if (view.current && !typing && key === "z" && (event.ctrlKey || event.metaKey) && !event.shiftKey) {
    event.preventDefault();
    return view.undo();
  }
  if (key.startsWith("arrow") && (!hand.pulls || event.target.closest?.("input, .handle"))) return;
  if (
    !view.current ||
    typing ||
    by("save-which").open ||
    event.ctrlKey ||
    event.metaKey ||
    event.altKey ||
    !(key in keys)
  )
    return;
  event.preventDefault();
  keys[key]();
});
addEventListener("keyup", (event) => event.key.toLowerCase() === "o" && view.current && view.original(false));
const clicks = {
  previous: () => step(-1),
  next: () => step(1),
  close: () => close(view.current),
  "zoom-in": stage.zoomIn,
  "zoom-out": stage.zoomOut,
  grid: toggleGrid,
  "full-screen": () => view.fullScreen(),
  sample,
};
for (const [id, clicked] of Object.entries(clicks)) by(id).addEventListener("click", clicked);
by("drop-area").addEventListener("click", (event) => !event.target.closest("#sample") && by("choose").click());
for (const name of ["pointerdown", "pointerup", "pointercancel", "pointerleave"]) {
  by("original").addEventListener(name, () => view.original(name === "pointerdown"));
}
by("zoom").append(
  ...[["", ""], ...words.zoomTo].map(([value, said]) => make("option", { value, hidden: !value }, said)),
);
by("zoom").addEventListener("change", () => {
  const scale = Number(by("zoom").value);
  if (scale) stage.zoomTo(scale);
  else stage.whole();
  by("zoom").value = ""; // the first, which says the present zoom
});
by("zoom").title = words.zoomHelp;
by("original").title = words.originalHelp;
by("save-all").addEventListener("click", () => saveAll(strip.shown, notice));
addEventListener("beforeunload", (event) => photos.some((photo) => photo.unsaved) && event.preventDefault());
addEventListener("pagehide", () => photos.forEach((photo) => photo.forget()));
watch(take);

about()
  .then((answer) => {
    settings = answer;
    arrange();
  })
  .catch(() => {}); // onHealth has said it
