// All words of the page, in English. Another language is another file like this, and another reasons.js.

import { count, percent, pixels, reasons } from "./reasons.js";

export { percent, reasons };

const [POSSIBLE, LIKELY] = [0.1, 0.5]; // least probabilities of a motion that is called so
export const LEAST_PX = 0.5; // less than this looks like no motion
const spanOf = ([low, high]) => (low === high ? "" : ` (anything from ${low.toFixed(1)} to ${high.toFixed(1)} ms)`);
const downloads = "the downloads of your browser";
const touch = matchMedia("(pointer: coarse)").matches;

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
  cancel: "Cancel",
  emptyTitle: touch ? "Choose photos or clips" : "Drop photos or clips here",
  emptyWords:
    "Photos taken from a train, a car or a moving hand lean and bend, since a camera reads its picture row by " +
    "row. unshutter straightens them. A photo that gives no clear answer is left unchanged, and you can help by hand.",
  choose: "Choose files…",
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
    changed: (n) => `Straightened ${n}`,
    look: (n) => `Please look ${n}`,
    alone: (n) => `Left unchanged ${n}`,
    failed: (n) => `Failed ${n}`,
  },
  allDone: "Looked through",
  doneOf: (done, total) => `${done} of ${total} looked through`,

  // states of a photo
  waiting: "waiting",
  loading: (share) => `loading ${percent(share)}`,
  finding: "finding the motion…",
  drawing: "drawing at full size…",
  working: "working…",
  failed: "cannot be used",
  failedHelp: "Close it with ×, and choose a photo or a clip (.mp4, .mov, .mkv …).",
  removeFailed: "Remove all that failed",
  savedToo: (state) => `${state} · saved`,
  changed: (sure) => (sure ? `straightened, ${sure}` : "straightened"),
  changedByHand: "straightened by hand",
  sure: { sure: "sure", likely: "likely", unsure: "unsure" },
  sureAtLength: { sure: "sure", likely: "likely", unsure: "unsure, please look" },
  unsureHelp:
    "How far things really moved is uncertain. If “after” looks wrong, take another of the small pictures, or straighten the photo by hand.",
  confidence: (sure) => `The result is closer to the truth than the photo with a probability of ${percent(sure)}`,
  alone: "left unchanged",

  clipState: {
    finding: "finding the motion…",
    opened: "not looked at yet",
    asking: "needs its readout time",
    done: "ready to save",
  },
  clipStateSaved: "saved",

  // what was done
  done: "What was done",
  moved: (px) => `Straightened: some places moved by up to ${pixels(px)}.`,
  movedByHand: (px) => `Straightened by hand: some places moved by up to ${pixels(px)}.`,
  // of a result with code and figures; a code of a later program keeps the program's sentence
  why: ({ code, figures, reason, confidence }) => {
    const line = reasons[code]?.(figures) ?? reason;
    const bare = ["no-motion", "no-visible-motion", "too-small"].includes(code); // whose figures lack the confidence
    return bare && confidence >= 0.5 ? `${line} (confidence ${percent(confidence)})` : line;
  },
  leftAlone: (reason) => `Left unchanged: ${reason}.`,
  youLeftAlone: "Left unchanged, as you asked.",
  nothingChanged: "There is nothing to save: the photo is unchanged.",
  left: (s) => (s < 90 ? `about ${Math.max(Math.round(s / 5) * 5, 5)} s left` : `about ${Math.round(s / 60)} min left`),

  // a file's name at the start stays in small letters
  sentence: (line, name) => `${name && line.startsWith(name) ? line[0] : line[0].toUpperCase()}${line.slice(1)}.`,

  filmUnused: (reason) => `Judged by the photo alone, since ${reason}.`,

  // a photo that was left unchanged, and what may help
  declined:
    "If something leans here, it may be perspective, or a camera held askew. If it is neither, say what you know, or straighten it by hand.",
  tried: (way, anyway, more) =>
    "Tried" +
    (way
      ? ` as if the camera moved${{ left: " to the left", right: " to the right", up: " upwards", down: " downwards", yes: "" }[way]}`
      : "") +
    `${anyway ? `${way ? "," : ""} at any confidence: still no motion was found.` : ": the photo still does not show it clearly."} ` +
    (more
      ? "If one of the small pictures looks right, take it; or straighten the photo by hand."
      : "If something still leans, straighten it by hand."),
  adviceWay: "Which way did the camera move?",
  ways: { left: "← left", right: "right →", yes: "It moved somehow" },
  adviceAnyway: "Straighten it even if unsure",
  adviceNeighbour: "Add the frame before or after…",
  adviceByHand: "By hand…",
  neighbourRefused: (reason) => `The neighbour frame cannot be used: ${reason}. The photo was looked at alone.`,
  ratioMissing:
    "The neighbour frame cannot be used yet: so few frames do not show how fast your camera reads out. " +
    "Type in its readout ratio. Until then, the photo is looked at alone.",
  adviceRatio: "Type in the ratio…",
  adviceNeighbours: "Change the neighbour frames…",
  adviceLeaveNeighbours: "Leave them out",

  // what else the motion of a photo could be
  candidates: "What it could be",
  candidate: ({ kind, direction }) =>
    kind === "pan"
      ? { left: "pan to the left", right: "pan to the right", up: "pan upwards", down: "pan downwards" }[direction]
      : { still: "as it is", hand: "hand shake", quadratic: "uneven motion", other: "motion" }[kind],
  candidateFigures: ({ largest_px: px, probability: share }, likeliest) => {
    const chance =
      share === null
        ? ""
        : share === likeliest
          ? "likeliest"
          : share < POSSIBLE
            ? "less likely"
            : share < LIKELY
              ? "possible"
              : "likely";
    return [px < LEAST_PX ? "" : pixels(px), chance].filter(Boolean).join(" · ");
  },
  candidateHelp: ({ kind, probability: share }) => {
    const what = kind === "still" ? "the likeliest other does not help" : "this helps";
    return "How far places would move" + (share === null ? "" : `. The chance that ${what} is ${percent(share)}`);
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
  resetHand: "Remove all of it",
  resetHandHelp: "Removes all lines and numbers set by hand",
  edgesCrop: (whole) => `Cut down to ${percent(whole)} of its area, so that no empty corners are left.`,
  edgesKeep: (whole) =>
    "Corners that the photo did not see stay empty" +
    (whole === null ? "." : `: cutting them off would leave ${percent(whole)} of it. Choose under “Empty corners”.`),
  edgesFill: (whole) =>
    "Corners that the photo did not see are filled with a mirror image of the photo" +
    (whole === null ? "." : `: cutting them off would leave ${percent(whole)} of it.`),
  edgesBorrow: "Corners that the photo did not see are borrowed from its neighbours.",
  heldSo: (roll, tilt, from) => {
    const parts = [];
    if (roll !== null) parts.push(`turned ${Math.abs(roll).toFixed(1)}° ${roll < 0 ? "anticlockwise" : "clockwise"}`);
    if (tilt !== null) parts.push(`tilted ${Math.abs(tilt).toFixed(1)}° ${tilt < 0 ? "down" : "up"}`);
    return `The camera was held ${parts.join(" and ")} (${from === "given" ? "as you say" : from}).`;
  },

  // controls
  settings: "Corrections",
  strength: "Strength [%]",
  strengthNumber: "Strength in per cent",
  advanced: "Advanced",

  // of options that the program describes: labels, choices and help where there are better words for the page
  usual: "as usual",
  option: {
    estimator: "Method",
    "focal-px": "Focal length [px]",
    "exposure-s": "Exposure time [s]",
    "readout-ms": "Readout time [ms]",
    "no-film": "Do not use the film inside the photo",
    quality: "Quality, 1 to 100",
    subsampling: "Colour resolution",
    fps: "Frames per second",
    codec: "Encoder",
    crf: "Quality (smaller is better)",
    preset: "Speed of the encoder",
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
    format: { "": "like the original", jpeg: "JPEG", png: "PNG", webp: "WebP", tiff: "TIFF", avif: "AVIF" },
    model: { "": "as the frames show", camera: "alike", dense: "differently" },
    subsampling: { "": "like the original" },
    "clip-edges": { fill: "fill", keep: "keep black", crop: "cut off", borrow: "borrow from neighbours" },
  },
  help: {
    moving: "In a train, on a car, on a drone: motion is likely. The way it went decides between candidates.",
    strength: "How much of the motion to undo: 100 % is all of it",
    upright: "Turned, whether or not the camera moved",
    edges:
      "Places that the photo did not see. Automatic: cut off where at least 80 % of the photo is left, else filled",
    format: "Of the file that is saved",
    "readout-ratio": "Time that the camera takes to read out a frame, as a share of the time from frame to frame",
  },

  upright: "Upright",
  turnedUpright: ({ roll_deg: roll, tilt_deg: tilt }) =>
    tilt === null
      ? `Levelled by ${Math.abs(roll).toFixed(1)}°.`
      : `Made upright: turned by ${Math.abs(roll).toFixed(1)}°, tilted by ${Math.abs(tilt).toFixed(1)}°.`,
  edges: "Empty corners",
  reference: "As it was when this row was read",
  referenceOf: { first: "first", middle: "middle", last: "last" },
  moving: "The camera was moving",
  anyway: "Straighten it even if unsure",
  leave: "Leave this photo alone",
  readout: "The sensor was read",
  readoutHelp: "Only if a program has turned or mirrored the file.",
  readoutOf: { auto: "as usual", down: "downwards", up: "upwards", right: "to the right", left: "to the left" },
  attitude: "How the camera was held",
  attitudeHelp: "The surest way to tell a leaning building from a tilted camera.",
  "roll-deg": "Turned clockwise [°]",
  "tilt-deg": "Tilted up [°]",
  neighbours: "Taken just before or after",
  neighboursHelp: "Another photo of the same burst, or frame of the same clip, shows how the camera moved.",
  neighbourOf: { before: "Taken before…", after: "Taken after…" },
  neighbourIs: { before: (name) => `Before: ${name}`, after: (name) => `After: ${name}` },
  neighbourForget: "Leave it out",
  "readout-ratio": "Readout ratio, 0 to 1",
  ratioHelp:
    "Time to read out a frame / time from frame to frame. A few frames rarely show it. If you do not know it, open a " +
    "clip that this camera took at the same speed, by hand: it is found there.",
  another: "Take it at another moment",
  at: (frames) => {
    const apart = Math.abs(frames);
    if (apart === 0) return "when its first row was read";
    if (apart === 1) return frames < 0 ? "at the frame before" : "at the frame after";
    return `${percent(apart)} of the way to the frame ${frames < 0 ? "before" : "after"}`;
  },
  atLabel: "Moment of the picture",
  more: "More",
  model: "Near and far move",
  fallback: "If its neighbours say nothing, use the photo alone",
  moment: (px) => `Straightened with the help of its neighbours: some places moved by up to ${pixels(px)}.`,
  curves: "Motion",
  curvesHelp: "How the scene moved while the rows were read, from the first row (top) to the last",
  curveTx: "sideways [px]",
  curveRz: "turning [°]",
  saveOne: "Save this photo",
  saveMotion: "Save motion",
  format: "File format",
  toAll: "Use these settings for all photos",
  toAllDone: "All photos have these settings now, except how the camera was held.",
  reset: "Reset",
  keys: "Keys",
  keyList: [
    ["← →", "move the divider, if it is selected; lean, bend and turn by hand"],
    ["J, K", "next, previous photo"],
    ["+ −, wheel, pinch", "zoom"],
    ["1, 2, 3 …", "what it could be: take one"],
    ["Z", "100 %, and back"],
    ["O", "hold: the original"],
    ["L", "lines that the program measures"],
    ["G", "grid"],
    ["F", "full screen"],
    ["S", "save this photo"],
    ["Ctrl+Z", "undo the last step by hand"],
  ],

  // clips
  moments: "Moments of the clip",
  momentAt: (time) => `The clip at ${time}`,
  time: (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`,
  play: "Play before and after",
  pause: "Pause",
  playAt: "Place in the film",
  filming: "Making a short film of the seconds around this moment",
  searching: "Finding the readout time and the motion",
  progress: "Progress",
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
      "Only in the saved clip do near and far move differently: the moments and the film here show the camera’s motion alone.",
  },
  clipCrop: "When the clip is saved, all frames are cut down to what every one of them saw.",
  clipIs: (time, width, height, fps) =>
    `The clip: ${time} long, ${width} × ${height} px, ${Number(fps.toFixed(2))} frames a second.`,
  sayReadout: "If you know how long your camera takes to read out a frame, type it in below.",
  readoutTime: "Readout time",
  readoutTimeOf: { find: "find it", camera: "that of a camera", ms: "in milliseconds", ratio: "as a share" },
  camera: "Camera (type to search)",
  readoutTimeHelp: "How long the camera takes to read out one frame. Two seconds of uneven motion show it.",
  readoutValueOf: { ms: "Milliseconds", ratio: "Share of the time from frame to frame" },
  readoutListed: ({ ms, plausible_ms: range, cameras }) =>
    range === null
      ? `${ms.toFixed(1)} ms, from the table of cameras (${cameras}).`
      : `The clip does not show it, so ${ms.toFixed(1)} ms is used. That is usual for ${cameras}${spanOf(range)}; ` +
        "if you know yours, choose it above.",
  readoutInFile: (ms) => `${ms.toFixed(1)} ms, from the clip's file.`,
  readoutEstimated: ({ ms, ms_sd: sd, ratio }) =>
    `Found: ${ms.toFixed(1)} ± ${sd.toFixed(1)} ms, a readout ratio of ${ratio.toFixed(2)}.`,
  partOf: "Only a part",
  start: "From [seconds]",
  end: "To [seconds]",
  clipToAll: "Use these settings for all clips",
  clipToAllDone: "All clips have these settings now.",
  making: ({ name, what, done, total }) => {
    const doing = {
      looking: "looking at all frames first",
      "readout time": "finding the readout time",
      gyro: "reading the gyro log",
    }[what];
    if (what === "waiting") return `${name}: waiting…`;
    if (!doing && !done) return `${name}: starting…`;
    return doing ? `${name}: ${doing}…` : `${name}: frame ${done} of ${total}`;
  },
  clipSaved: ({ name, frames, rectified, left_out: lost }) =>
    `${name}: saved to ${downloads}, ${rectified} of ${count(frames, "frame", "frames")} straightened` +
    `${rectified < frames ? ", the others left unchanged" : ""}.${lost.length ? ` Such a file has no place for ${lost.join(", ")}.` : ""}`,
  clipUnchanged: (name, reason) => `${name}: nothing was saved, since no frame was straightened: ${reason}.`,
  clipKeyList: [
    ["← →", "move the divider, if it is selected"],
    ["J, K", "next, previous"],
    ["1 … 5", "the moments"],
    ["P", "play, pause"],
    ["Z", "100 %"],
    ["S", "save this clip"],
  ],
  noClips: (name, command) => `${name} is a clip. To open clips, install what they need: ${command}`,

  // saving
  savedOne: (name) => `${name}: saved to ${downloads}.`,
  saving: (done, total) => `Saving: ${done} of ${count(total, "file", "files")}`,
  fetching: "Fetching the file…",
  saved: (n, failed) =>
    `${count(n, "file", "files")} saved to ${downloads}` +
    (failed.length ? `; not saved: ${failed.map((each) => `${each.name} (${each.error})`).join(", ")}` : "."),
  cancelled: "Cancelled.",
  nothingToSave: "There is nothing to save yet.",
  noneChanged: "Nothing was saved: none of them was straightened.",

  // what goes wrong
  tooLarge: (name, mb) => `${name} is larger than ${mb} MB, the limit set by --max-mb.`,
  gone: "unshutter does not answer. Is it still running? This page goes on as soon as it is back.",
  oldLink: "This link is not valid (any more): open the one that “unshutter serve” has printed.",
  error: (name, line) => `${name}: ${line}`,
};
