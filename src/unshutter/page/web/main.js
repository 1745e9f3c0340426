// The page: photos and clips come in, one of them is looked at, others wait in the strip.

/** @import { About, Item } from "./types.js" @import { Word } from "./words.js" */

import { about, onHealth } from "./api.js";
import { findBursts } from "./bursts.js";
import { Clip, isClip } from "./clip.js";
import { watch } from "./incoming.js";
import { element } from "./nodes.js";
import { shared } from "./panel.js";
import { Photo } from "./photo.js";
import { saveAll } from "./saving.js";
import { pressed, VECTORS } from "./stage.js";
import { Strip } from "./strip.js";
import { keepOpen } from "./tab.js";
import { View } from "./view.js";
import { button } from "./widgets.js";
import { words } from "./words.js";

const AT_ONCE = 2; // photos that are worked on in the background
const NOTICE_MS = 12000;
const STEP_PX = 60; // that an arrow key moves a picture that is zoomed in

/** @type {Item[]} */
const items = [];
/** @type {About} */
let settings = { max_bytes: Infinity, max_clip_bytes: Infinity, clips: true, install_clips: "" };
/** @type {Set<Item>} that are worked on in the background */
const atWork = new Set();
let glimpsing = false;

for (const node of document.querySelectorAll("[data-word]")) node.prepend(wordOf(node, "data-word"));
for (const node of document.querySelectorAll("[data-label]")) {
  node.setAttribute("aria-label", wordOf(node, "data-label"));
}
const save = button("saveAll", () => saveAll(strip.shown, notice));
element("header").append(save);
element("choosing").append(
  button("chooseFiles", () => {}, { class: "main" }),
  button("sample", sample),
);
const strip = new Strip(element("thumbnails"), element("strip-bar"), { pick: show, close, filtered });
const view = new View({ notice, toAll, step, close: () => view.current && close(view.current) });

/** @param {Element} node @param {string} attribute */
function wordOf(node, attribute) {
  return words[/** @type {Word} */ (node.getAttribute(attribute))];
}

// ---- photos come and go ----

/** @param {File[]} files */
function take(files) {
  const taken = files.filter(isWelcome).map((file) => (isClip(file) ? new Clip(file) : new Photo(file)));
  for (const item of taken) {
    items.push(item);
    strip.add(item);
    item.addEventListener("change", () => changed(item));
  }
  if (taken.length) show(taken[0]);
  arrange();
  workInBackground();
}

/** @param {Item} item */
function changed(item) {
  if (item === view.current) view.update();
  if (item.state === "waiting") workInBackground();
  findBursts(items);
}

/** Whether a file can be opened; if not, it is said why. @param {File} file */
function isWelcome(file) {
  const most = isClip(file) ? settings.max_clip_bytes : settings.max_bytes;
  const fits = file.size <= most;
  if (isClip(file) && !settings.clips) notice(words.noClips(file.name, settings.install_clips));
  else if (!fits) notice(words.tooLarge(file.name, most / 1e6));
  return fits && (settings.clips || !isClip(file));
}

/** @param {Item} item */
function show(item) {
  strip.select(item);
  view.show(item);
  arrange();
  const phone = matchMedia("(max-height: 30em)").matches; // on which the page is longer than the screen
  scrollTo(0, phone ? element("viewer").offsetTop : 0);
}

/** @param {Item} item */
function close(item) {
  const place = items.indexOf(item);
  items.splice(place, 1);
  strip.remove(item);
  item.forget();
  findBursts(items);
  if (item === view.current) {
    view.show(null);
    if (items.length) show(items[Math.min(place, items.length - 1)]);
  }
  arrange();
}

/** @param {number} by */
function step(by) {
  const { current } = view;
  const shown = items.filter((item) => item === current || strip.shown.includes(item));
  const next = current && shown[shown.indexOf(current) + by];
  if (next) show(next);
}

/** Only those that the filter shows are saved. @param {number} shown */
function filtered(shown) {
  save.textContent = shown === items.length ? words.saveAll : words.saveShown(shown);
}

function arrange() {
  const many = items.length > 1;
  element("empty").hidden = items.length > 0;
  element("viewer").hidden = !items.length;
  if (!items.length) for (const id of ["panel", "clip-panel"]) element(id).hidden = true;
  view.bar.many = many;
  for (const node of [element("strip"), save, view.controls.toAll, view.clipControls.toAll])
    if (node) node.hidden = !many;
}

/** What nobody looks at gets its motion, too: photos a few at a time, and after them a clip at a time. */
function workInBackground() {
  glimpseAhead();
  while (atWork.size < AT_ONCE) {
    const waiting = items.filter((each) => each.state === "waiting" && each !== view.current && !atWork.has(each));
    const item = waiting.find(({ kind }) => kind === "photo") ?? (atWork.size ? null : waiting[0]);
    if (!item) return;
    atWork.add(item);
    const done = () => {
      atWork.delete(item);
      workInBackground();
    };
    item.small().then(done, done);
  }
}

/** All get a first picture before their turn, one after the other, and first those that the browser can draw. */
async function glimpseAhead() {
  if (glimpsing) return;
  glimpsing = true;
  for (;;) {
    const [item] = items.filter(({ looks }) => looks < 2).sort((one, other) => one.looks - other.looks);
    if (!item) break;
    await item.look().catch(() => {}); // its turn will show what is wrong
  }
  glimpsing = false;
}

/** The others get the options of the current one, but for those that are true of one alone. */
function toAll() {
  const { current } = view;
  if (!current) return;
  for (const item of items) {
    if (item === current || item.kind !== current.kind) continue;
    item.options = shared(current.options, item.options);
    item.become("change");
  }
  notice(current.kind === "clip" ? words.clipToAllDone : words.toAllDone);
}

async function sample() {
  const answer = await fetch("/page/sample.jpg");
  take([new File([await answer.blob()], "sample.jpg", { type: "image/jpeg" })]);
}

// ---- what is told ----

let lasting = 0;

/** @param {string} line @param {string} details */
function notice(line, details = "") {
  element("notice").textContent = line;
  element("notice").title = details;
  element("notice").hidden = !line;
  clearTimeout(lasting);
  if (line) lasting = setTimeout(() => notice(""), NOTICE_MS);
}

onHealth((health) => {
  const said = { gone: words.gone, "old link": words.oldLink };
  if (health) notice(said[health]);
  else if (Object.values(said).includes(element("notice").textContent ?? "")) notice("");
});

// ---- keys, and what else happens to the page ----

const {
  stage,
  controls: { hand },
} = view;
/** @type {Record<string, () => unknown>} */
const keys = {
  j: () => step(1),
  k: () => step(-1),
  z: () => stage.toggleZoom(),
  l: () => view.toggleLines(),
  f: () => view.fullScreen(),
  o: () => (stage.original = true),
  "+": stage.zoomIn,
  "=": stage.zoomIn,
  "-": stage.zoomOut,
  0: () => stage.whole(),
  s: () => view.save(),
  p: () => view.play(),
  g: () => view.bar.toggleGrid(),
  escape: () => hand.stop(),
};
for (let number = 1; number <= 9; number++) keys[number] = () => view.pick(number);
for (const [way, [across, down]] of Object.entries(VECTORS)) {
  keys[`arrow${way}`] = () =>
    hand.pulls ? hand.nudge(across + down) : stage.shiftBy(-STEP_PX * across, -STEP_PX * down);
}

addEventListener("keydown", (event) => {
  const typing = pressed(event, "input:not([type=checkbox],[type=radio],[type=range]), select, textarea");
  const [key, held] = [event.key.toLowerCase(), event.ctrlKey || event.metaKey];
  const dialog = /** @type {HTMLDialogElement} */ (element("save-which"));
  if (!view.current || typing) return;
  if (held && (key === "y" || key === "z")) {
    event.preventDefault();
    return view.goBy(key === "y" || event.shiftKey ? 1 : -1);
  }
  if (event.defaultPrevented || dialog.open || held || event.altKey || !(key in keys)) return;
  const moves = hand.pulls ? !pressed(event, "input") : stage.zoomed && !pressed(event, "input, aside");
  if (key.startsWith("arrow") && !moves) return;
  event.preventDefault();
  keys[key]();
});
addEventListener("keyup", (event) => {
  if (event.key.toLowerCase() === "o") stage.original = false;
});
element("drop-area").addEventListener("click", (event) => !pressed(event, "#sample") && element("choose").click());
addEventListener("beforeunload", (event) => {
  if (!element("saving").hidden || items.some((item) => item.unsaved)) event.preventDefault();
});
addEventListener("pagehide", () => items.forEach((item) => item.forget()));
watch(take);
keepOpen(take, notice);

about()
  .then((answer) => {
    settings = answer;
    arrange();
  })
  .catch(() => {}); // onHealth has said it
