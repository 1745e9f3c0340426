// All words of the page, in English, but for those that the program sends: reasons, and the help of options. Another
// language is another file like this, and another page/sentences.py. A button has its words under its own name.

/** @typedef {{ [K in keyof typeof words]: (typeof words)[K] extends string ? K : never }[keyof typeof words]} Word */
/** @typedef {string | string[][] | ((...figures: any[]) => string) | { [name: string]: Said }} Said */

/** Numbers as the page writes them, and reasons.py. @param {number} share */
export const percent = (share) => `${share < 1 ? Math.min(Math.round(100 * share), 99) : Math.round(100 * share)} %`;
/** @param {number} px */
const pixels = (px) => (px >= 10 ? `${px.toFixed(0)} px` : `${px.toFixed(1)} px`);
/** @param {number} n @param {string} one @param {string} [many] */
const count = (n, one, many = `${one}s`) => (n === 1 ? `1 ${one}` : `${n} ${many}`);
/** @param {string[]} lost */
const notKept = (lost) => (lost.length ? ` Not kept: ${lost.join(", ")}.` : "");
/** @param {number} deg */
const degrees = (deg) => `${Math.abs(deg).toFixed(1)}°`;

const NUMBERS = ["", "", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];
const [cancel, reset] = ["Cancel", "Reset"];
const downloads = "the downloads of your browser";
const touch = matchMedia("(pointer: coarse)").matches;
const waysOf = { left: " to the left", right: " to the right", up: " upwards", down: " downwards", yes: "" };

/** @satisfies {Record<string, Said>} */
export const words = {
  add: "Add photos or clips…",
  saveAll: "Save all (zip)",
  saveShown: (n) => `Save these ${n} (zip)`,
  saveWhich: (changed, total) =>
    changed
      ? `${changed} of ${total} were straightened. Which ones do you want to save?`
      : `None of these ${total} has been straightened. What do you want to save?`,
  saveChanged: "Only straightened ones",
  saveUnchanged: "All, unchanged ones as they are",
  saveNone: cancel,
  emptyTitle: touch ? "Choose photos or clips" : "Drop photos or clips here",
  leans: "It leans",
  bends: "It bends",
  wobbles: "It wobbles",
  emptyWords:
    "The camera moved while it read the picture row by row, in a train, a car or your hand. unshutter straightens " +
    "that. A photo that gives no clear answer is left unchanged, and you can help by hand.",
  chooseFiles: "Choose files…",
  sample: "Try a sample photo",
  emptyPrivate: "Nothing leaves this computer: the page talks to a program that runs on it.",
  viewer: "Before and after",
  photos: "Photos and clips",
  previous: "Previous",
  next: "Next",
  closeThis: "Close this photo or clip",
  original: "Hold for original",
  originalHelp: "Hold it down to see the photo as it was taken (key O)",
  linesFound: "Show lines",
  zoom: "Zoom",
  zoomTo: [
    ["fit", "Fit"],
    ["0.5", "50 %"],
    ["1", "100 %"],
    ["2", "200 %"],
  ],
  zoomHelp: "100 %: one pixel of the screen for each pixel of the photo (key Z)",
  zoomIn: "Zoom in (key +)",
  zoomOut: "Zoom out (key −)",
  grid: "Grid (key G)",
  fullScreen: "Full screen (key F)",
  slider: "Divider between before and after",
  before: "before",
  after: "after",
  beforeAlt: (name) => `${name}, as it was taken`,
  afterAlt: (name) => `${name}, straightened`,
  close: (name) => `Close ${name}`,

  filter: "Show",
  filterOf: {
    all: (n) => `All ${n}`,
    changed: (n, levelled) => `Straightened${levelled ? " or levelled" : ""} ${n}`,
    look: (n) => `Please look ${n}`,
    alone: (n) => `Left unchanged ${n}`,
    failed: (n) => `Failed ${n}`,
  },
  seeChanged: "See them",
  changedOf: (changed, total, levelled) =>
    `${changed} of ${total} ${changed === 1 ? "was" : "were"} straightened${levelled ? " or levelled" : ""}: ` +
    `see ${changed === 1 ? "it" : "them"}`,
  allDone: "Looked through",
  doneOf: (done, total) => `${done} of ${total} looked through`,

  // states of a photo or clip (states.js)
  state: {
    waiting: "waiting",
    loading: (share) => `loading ${percent(share)}`,
    finding: "finding the motion…",
    asking: "needs its readout time",
    done: "ready to save",
    changed: (sure) => (sure ? `straightened, ${sure}` : "straightened"),
    alone: "left unchanged",
    failed: "cannot be used",
  },
  changedByHand: "straightened by hand",
  levelled: "levelled",
  saved: "saved",
  opening: "opening the clip…",
  drawing: "drawing at full size…",
  working: "working…",
  failedHelp: "Close it with ×, and choose a photo or a clip (.mp4, .mov, .mkv …).",
  removeFailed: "Remove all that failed",
  sureAtLength: (sure, doubted) => (doubted ? `${sure}, please look` : sure),
  doubtedHelp:
    "How far things really moved is uncertain. If “after” looks wrong, take another of the small pictures, or " +
    "straighten the photo by hand.",
  confidence: (sure) => `The result is closer to the truth than the photo with a probability of ${percent(sure)}`,

  // what was done
  done: "What was done",
  moved: (px) => `Straightened: some places moved by up to ${pixels(px)}.`,
  movedByHand: (px) => `Straightened by hand: some places moved by up to ${pixels(px)}.`,
  leftAlone: (reason) => `Left unchanged: ${reason}.`,
  youLeftAlone: "Left unchanged, as you asked.",
  nothingChanged: "There is nothing to save: the photo is unchanged.",
  left: (s) => (s < 90 ? `about ${Math.max(Math.round(s / 5) * 5, 5)} s left` : `about ${Math.round(s / 60)} min left`),
  // a file's name at the start stays in small letters
  sentence: (line, name = "") => `${name && line.startsWith(name) ? line[0] : line[0].toUpperCase()}${line.slice(1)}.`,
  hdrKept: "HDR kept: the page shows it in SDR, the saved photo is HDR.",
  videoUnused: (reason) => `Judged by the photo alone, since ${reason}.`,

  // a photo that was left unchanged, and what may help: buttons as the program advises them (page/sentences.py)
  declined:
    "If something leans here, it may be perspective, or a camera held askew. If it is neither, say what you know, " +
    "or straighten it by hand.",
  heldAskew: "The camera seems to have been held askew.",
  tried: (/** @type {keyof typeof waysOf | undefined} */ way, anyway, more) => {
    const how = `${way ? ` as if the camera moved${waysOf[way]}` : ""}${way && anyway ? "," : ""}`;
    const came = anyway
      ? " at any confidence: still no motion was found."
      : ": the photo still does not show it clearly.";
    const next = more
      ? "If one of the small pictures looks right, take it; or straighten the photo by hand."
      : "If something still leans, straighten it by hand.";
    return `Tried${how}${came} ${next}`;
  },
  adviceWay: "Which way did the camera move?",
  ways: { left: "← left", right: "right →", yes: "It moved somehow" },
  adviceLevel: (deg, error) => `Level it: turn it by ${degrees(deg)} ± ${degrees(error)}`,
  adviceAnyway: "Straighten it even if unsure",
  adviceNeighbour: "Add the frame before or after…",
  adviceByHand: "By hand…",
  neighbourRefused: (reason) => `The neighbour frame cannot be used: ${reason}. The photo was looked at alone.`,
  burst: (n) => `These ${NUMBERS[n] ?? n} look like a burst: together they show how the camera moved.`,
  useBurst: "Use them together",
  adviceNeighbours: "Change the neighbour frames…",
  adviceLeaveNeighbours: "Leave them out",

  // what else the motion of a photo could be
  candidates: "What it could be",
  candidate: { still: "as it is", hand: "hand shake", quadratic: "uneven motion", other: "motion" },
  pan: { left: "pan to the left", right: "pan to the right", up: "pan upwards", down: "pan downwards" },
  candidateFigures: ({ kind, largest_px: px, within_error: within, probability: share, certainty }, likeliest) => {
    const chance = share !== null && share === likeliest ? "likeliest" : certainty;
    return [kind === "still" || within ? "" : pixels(px), chance].filter(Boolean).join(" · ");
  },
  candidateHelp: ({ kind, within_error: within, probability: share }) => {
    const chance = share === null ? "" : ` with a probability of ${percent(share)}`;
    if (kind === "still") return chance && `Leaving the photo is right${chance}`;
    const far = within ? "Places would move by no more than the typical error" : "How far places would move";
    return `${far}${chance && `. It helps${chance}`}`;
  },

  // by hand
  byHand: "By hand",
  byHandHelp: "Press a button, then drag in the photo.",
  tool: {
    lean: "Lean [°]",
    bend: "Bend [%]",
    turn: "Turn [°]",
    upright: "Upright line",
    level: "Level line",
    straight: "Bent edge",
  },
  toolHelp: {
    lean: "Drag in the photo, or press the arrow keys, until what is upright stands upright.",
    bend: "Drag the middle of the photo, or press the arrow keys, until what is straight is not bent any more.",
    turn: "Drag in the photo, or press the arrow keys, until the top and the bottom are not turned against each other.",
    upright: "Drag along something that stands upright: a corner of a house, a lamp post. Two or more are best.",
    level:
      "Drag along something level: a sill, a row of windows, a kerb. It becomes level, so draw along what faces you.",
    straight: "Drag from end to end of something straight that looks bent, then pull the middle onto it.",
  },
  toolDone: "Done",
  toolDoneHelp: "Shows the photo straightened (key Escape)",
  lineOf: { upright: "upright line", level: "level line", straight: "bent edge" },
  lineTrouble: { sideways: "runs the other way: not used", contradicts: "cannot be met with the others" },
  lineEnd: (line, number, end) => `Point ${end} of line ${number}, ${line}`,
  lineRemove: (line, number) => `Remove ${line} ${number}`,
  undoHand: "Undo",
  undoHandHelp: "Takes back the last step by hand (Ctrl+Z)",
  redoHand: "Redo",
  redoHandHelp: "Does again what was undone (Ctrl+Y, Ctrl+Shift+Z)",
  resetHand: "Remove all of it",
  resetHandHelp: "Removes all lines and numbers set by hand",
  edgesCrop: (whole) => `Cut down to ${percent(whole)} of its area, so that no empty corners are left.`,
  edgesKeep: (whole) =>
    whole === null
      ? "Corners that the photo did not see stay empty."
      : `Corners that the photo did not see stay empty: cutting them off would leave ${percent(whole)} of it. ` +
        "Choose under “Empty corners”.",
  edgesFill: "Corners that the photo did not see are filled with a mirror image of the photo.",
  littleLeft: "Please look: much is cut off. “Keep” and “fill” under “Empty corners” leave the photo its size.",
  edgesBorrow: "Corners that the photo did not see are borrowed from its neighbours.",
  heldSo: (roll, tilt, from) => {
    const turned = roll === null ? "" : `turned ${degrees(roll)} ${roll < 0 ? "anticlockwise" : "clockwise"}`;
    const tilted = tilt === null ? "" : `tilted ${degrees(tilt)} ${tilt < 0 ? "down" : "up"}`;
    const how = [turned, tilted].filter(Boolean).join(" and ");
    return `The camera was held ${how} (${from === "given" ? "as you say" : from}).`;
  },
  turnedUpright: ({ roll_deg: roll, tilt_deg: tilt }) =>
    tilt === null
      ? `Levelled by ${degrees(roll)}.`
      : `Made upright: turned by ${degrees(roll)}, tilted by ${degrees(tilt)}.`,

  // of options that the program describes: labels, choices and help where there are better words for the page
  usual: "as usual",
  option: {
    strength: "Strength [%]",
    upright: "Upright",
    moving: "The camera was moving",
    edges: "Empty corners",
    format: "File format",
    reference: "Moment that the picture shows",
    "roll-deg": "Turned clockwise [°]",
    "tilt-deg": "Tilted up [°]",
    "readout-ratio": "Readout ratio",
    model: "Near and far move",
    stabilize: "Steady the camera",
    fallback: "Use the photo alone if its neighbours show no motion",
    camera: "Camera (type to search)",
    start: "From [seconds]",
    end: "To [seconds]",
    estimator: "Method",
    "focal-px": "Focal length [px]",
    "exposure-s": "Exposure time [s]",
    "readout-ms": "Readout time [ms]",
    "no-film": "Do not use the video inside the photo",
    quality: "Quality, 1 to 100",
    subsampling: "Colour resolution",
    fps: "Frames per second",
    codec: "Encoder",
    crf: "Quality",
    preset: "Speed of the encoder",
    bitrate: "Size",
  },
  choices: {
    moving: {
      "": "not known",
      yes: "yes",
      left: "to the left",
      right: "to the right",
      up: "upwards",
      down: "downwards",
    },
    upright: { "": "as it was taken", level: "level", full: "level, verticals parallel" },
    edges: { auto: "automatic", keep: "keep", crop: "cut off", fill: "fill", borrow: "borrow from neighbours" },
    "clip-edges": { auto: "automatic", fill: "fill", keep: "keep black", crop: "cut off", borrow: "from neighbours" },
    format: { "": "like the original" },
    model: { "": "as the frames show", camera: "alike", dense: "differently" },
    bitrate: { "": "by quality", same: "as the clip" },
    subsampling: { "": "like the original" },
  },
  help: {
    moving: "In a train, on a car, on a drone: motion is likely. The way it went decides between candidates.",
    strength: "How much of the motion to undo: 100 % is all of it",
    upright: "Turned, whether or not the camera moved",
    edges: "Places that the photo did not see. Automatic: borrowed from its neighbours where it has any, else cut off",
    format: "Of the file that is saved",
    crf: "Of the clip that is saved. Smaller: about half of visually lossless",
    stabilize: "Smooths away movements of the camera that are shorter than so many seconds",
    "readout-ratio": "Time that the camera takes to read out a frame, as a share of the time from frame to frame",
  },
  steadyHow: "How steady",
  steadyOf: {
    0.5: (s) => `a little (${s} s)`,
    1: (s) => `as usual (${s} s)`,
    2: (s) => `very (${s} s)`,
  },
  ownCodec: "that of the clip",
  encoderOf: {
    libx264: "H.264 (libx264)",
    libx265: "H.265 (libx265)",
    libsvtav1: "AV1 (libsvtav1)",
    "libvpx-vp9": "VP9 (libvpx-vp9)",
    prores_ks: "ProRes (prores_ks)",
    ffv1: "FFV1, lossless",
  },
  qualityOf: { asClip: "as the clip", best: "visually lossless", small: "smaller" },
  strengthNumber: "Strength in per cent",
  referenceOf: { first: "first", middle: "middle", last: "last" },

  // other controls
  settings: "Corrections",
  advanced: "Advanced",
  anyway: "Straighten it even if unsure",
  leave: "Leave this photo alone",
  readout: "The sensor was read",
  readoutHelp: "Only if a program has turned or mirrored the file.",
  readoutOf: { auto: "as usual", down: "downwards", up: "upwards", right: "to the right", left: "to the left" },
  attitude: "How the camera was held",
  attitudeHelp: "The surest way to tell a leaning building from a tilted camera.",
  neighbours: "Taken just before or after",
  neighboursHelp: "Another photo of the same burst, or frame of the same clip, shows how the camera moved.",
  neighbourOf: { before: "Taken before…", after: "Taken after…" },
  neighbourIs: { before: (name) => `Before: ${name}`, after: (name) => `After: ${name}` },
  neighbourForget: "Leave it out",
  ratioFrom: (source) =>
    source === "usual value"
      ? "So few frames do not show it: this is a usual value. Move it until what is upright stands upright."
      : source === "motion"
        ? "Found from the frames."
        : `Usual for this camera (${source}).`,
  ratioHelp: "A clip that this camera took by hand, at the same speed, shows it: open one here.",
  another: "Take it at another moment",
  at: (frames) => {
    const [apart, which] = [Math.abs(frames), frames < 0 ? "before" : "after"];
    if (apart === 0) return "when its first row was read";
    return apart === 1 ? `at the frame ${which}` : `${percent(apart)} of the way to the frame ${which}`;
  },
  atLabel: "Moment of the picture",
  more: "More",
  moment: (px) => `Straightened with the help of its neighbours: some places moved by up to ${pixels(px)}.`,
  curves: "Motion",
  curvesHelp: "How the scene moved while the rows were read, from the first row (top) to the last",
  curveTx: "sideways [px]",
  curveRz: "turning [°]",
  saveOne: "Save this photo",
  saveMotion: "Save motion",
  toAll: "Use these settings for all photos",
  toAllDone: "All photos have these settings now, except how the camera was held.",
  reset,
  keys: "Keys",
  keyList: [
    ["← ↑ → ↓", "the divider, if it is selected; a photo that is zoomed in; lean, bend and turn by hand"],
    ["J, K", "next, previous photo"],
    ["+ −, wheel, pinch", "zoom"],
    ["1, 2, 3 …", "what it could be: take one"],
    ["Z", "100 %, and back"],
    ["O", "hold: the original"],
    ["L", "lines that the program measures"],
    ["G", "grid"],
    ["F", "full screen"],
    ["S", "save this photo"],
    ["Ctrl+Z, Ctrl+Y", "undo the last step by hand, redo it"],
  ],

  // clips
  moments: "Moments of the clip",
  momentAt: (time) => `The clip at ${time}`,
  time: (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`,
  play: "Play before and after",
  pause: "Pause",
  playAt: "Place in the video",
  filming: "Making a short video of the seconds around this moment",
  searching: "Finding the readout time and the motion",
  progress: "Progress",
  stopSearch: cancel,
  stopped: "the search for the readout time was cancelled",
  clipFirst: "This is a first look, with the readout time that is usual for such a camera.",
  saveClip: "Save this clip",
  clipNotYet: "There is nothing to save until the readout time of the clip is known.",
  clipMoved: (px) => `At this moment, some places moved by up to ${pixels(px)}.`,
  clipAlone: (reason) => `This moment is left unchanged${reason ? `: ${reason}` : ""}.`,
  clipStrength0: "The clip is left unchanged, as you asked.",
  clipOnlySaved: {
    stabilize: "“Play before and after” shows it; single moments do not.",
    model:
      "Only in the saved clip do near and far move differently: the moments and the video here show the camera’s " +
      "motion alone.",
  },
  clipCrop: "When the clip is saved, all frames are cut down to what every one of them saw.",
  clipIs: (time, { width, height, fps }) =>
    `The clip: ${time} long, ${width} × ${height} px, ${Number(fps.toFixed(2))} frames a second.`,
  sayReadout: "If you know how long your camera takes to read out a frame, type it in below.",
  readoutTime: "Readout time",
  readoutTimeOf: { find: "find it", camera: "that of a camera", ms: "in milliseconds", ratio: "as a share" },
  readoutTimeHelp: "How long the camera takes to read out one frame. Two seconds of uneven motion show it.",
  readoutValueOf: { ms: "Milliseconds", ratio: "Share of the time from frame to frame" },
  readoutListed: ({ ms, plausible_ms: range, cameras, left }) => {
    if (left) return "The clip does not show it and is left unchanged; if you know it, choose it above.";
    if (range === null) return `${ms.toFixed(1)} ms, from the table of cameras (${cameras}).`;
    const [low, high] = range;
    const span = low === high ? "" : ` (anything from ${low.toFixed(1)} to ${high.toFixed(1)} ms)`;
    const usual = `so ${ms.toFixed(1)} ms is used. That is usual for ${cameras}${span}`;
    return `The clip does not show it, ${usual}; if you know yours, choose it above.`;
  },
  readoutInFile: ({ ms }) => `${ms.toFixed(1)} ms, from the clip's file.`,
  readoutEstimated: ({ ms, ms_sd: sd, ratio, direction, wobble_px: px }) => {
    const way = direction ? `, read ${direction.replaceAll("-", " ")}` : "";
    const wobble = px === null ? "" : ` The clip wobbles by ${px.toFixed(px < 1 ? 2 : 1)} px from frame to frame.`;
    return `Found: ${ms.toFixed(1)} ± ${sd.toFixed(1)} ms, a readout ratio of ${ratio.toFixed(2)}${way}.${wobble}`;
  },
  partOf: "Only a part",
  clipToAll: "Use these settings for all clips",
  clipToAllDone: "All clips have these settings now.",
  clipReset: reset,
  makingOf: {
    looking: "looking at all frames first",
    "readout time": "finding the readout time",
    gyro: "reading the gyro log",
    judging: "checking what straightening gains",
  },
  making: ({ what, done, total }, doing) => {
    if (what === "waiting") return "waiting…";
    if (doing) return `${doing}…`;
    return done ? `frame ${done} of ${total}` : "starting…";
  },
  clipSaved: ({ name, frames, rectified, left_out: lost, as_they_were: kept }) => {
    const others = rectified < frames ? ", the others left unchanged" : "";
    const asTheyWere = kept.length ? ` Left unchanged: ${kept.join(", ")}.` : "";
    const share = `${rectified} of ${count(frames, "frame")} straightened`;
    return `${name}: saved to ${downloads}, ${share}${others}.${notKept(lost)}${asTheyWere}`;
  },
  part: ({ name, fate, reason }) => `${fate}: ${name}${reason ? ` (${reason})` : ""}`,
  clipUnchanged: (name, reason) => `${name}: nothing was saved, since no frame was straightened: ${reason}.`,
  clipKeyList: [
    ["← ↑ → ↓", "the divider, if it is selected; a frame that is zoomed in"],
    ["J, K", "next, previous"],
    ["1 … 5", "the moments"],
    ["P", "play, pause"],
    ["Z", "100 %"],
    ["S", "save this clip"],
  ],
  noClips: (name, command) => `${name} is a clip. To open clips, install what they need: ${command}`,

  // saving
  savedOne: (name, lost) => `${name}: saved to ${downloads}.${notKept(lost)}`,
  saving: (done, total) => `Saving: ${done} of ${count(total, "file")}`,
  stopSaving: cancel,
  fetching: "Fetching the file…",
  savedMany: (n, failed, lost) =>
    `${count(n, "file")} saved to ${downloads}${failed ? `; not saved: ${failed}` : "."}${notKept(lost)}`,
  cancelled: "Cancelled.",
  nothingToSave: "There is nothing to save yet.",
  noneChanged: "Nothing was saved: none of them was straightened.",

  tooLarge: (name, mb) => `${name} is larger than ${mb} MB, the limit set by --max-mb.`,
  gone: "unshutter does not answer. Is it still running? This page goes on as soon as it is back.",
  oldLink: "This link is not valid (any more): open the one that “unshutter serve” has printed.",
  error: (name, line) => `${name}: ${line}`,
};
