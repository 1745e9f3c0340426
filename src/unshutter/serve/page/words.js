// All words of the page, in English. Another language is another file like this.

const percent = (share) => `${Math.floor(100 * share + 1e-9)} %`;
const probability = (share) => (share < 0.01 ? "< 1 %" : share > 0.99 ? "> 99 %" : percent(share));
const pixels = (px) => (px >= 10 ? `${px.toFixed(0)} px` : `${px.toFixed(1)} px`);
export const LEAST_PX = 0.5; // less than this looks like no motion
const count = (n, one, many) => (n === 1 ? `1 ${one}` : `${n} ${many}`);

// Code of a reason -> why a photo, moment or clip is left unchanged, with the reason's figures.
export const reasons = {
  "stated": ({ sentence }) => sentence,
  "too-long": ({ aspect }) => `one side is more than ${aspect} times as long as the other`,
  "too-few-segments": ({ segments }) => `only ${count(segments, "straight line was", "straight lines were")} found`,
  "no-right-angles": () => "the photo shows no right angles",
  "too-fast-for-hands": () => "the lines would mean more motion than a hand-held camera makes",
  "too-sharp": ({ exposure }) => `it is too sharp for a camera that moved during an exposure of ${exposure}`,
  "no-rolling-shutter": () => "this camera exposes all rows at once",
  "hovered": () => "the drone hovered",
  "film-stood-still": () => "the camera stood still, as the film inside it shows",
  "impossible-motion": ({ detail }) => `no camera moves like that: ${detail}`,
  "asked-for-nothing": () => "that is what you asked for",
  "no-motion": () => "the camera did not move",
  "no-visible-motion": () => "no motion can be seen",
  "strength-0": () => "the strength is 0",
  "unsure": ({ confidence }) => `not sure how the camera moved (confidence ${percent(confidence)})`,
  "unsure-whether-moved": ({ confidence }) => `not sure whether the camera moved (confidence ${percent(confidence)})`,
  "too-small": () => "nothing would move by as much as half a pixel",
  "stood-still": () => "the camera stood still",
  "nothing-moved": () => "nothing moved between the frames",
  "nothing-to-see": ({ px }) => `nothing to see: at most ${px.toFixed(1)} px at any plausible readout time`,
  "hardly-moved": () => "the camera hardly moved",
  "no-common-motion": () => "near and far move too differently for one motion of the camera",
  "only-others-moved": () => "the camera stood still; what moved in front of it is not straightened",
  "no-neighbour": () => "there is no frame before or after it",
  "shot-too-short": () => "the shot is too short to show how the camera moved",
  "other-size": () => "the frames before and after it have another size",
  "too-little-to-follow": () => "there is too little to follow from frame to frame",
  "scenes-differ": () => "its neighbours show another scene, or near and far move too differently in them",
  "frames-disagree": () => "the frames do not show how the camera moved",
  "ratio-unknown": ({ why }) => `the readout time cannot be found from these frames (${why}); if you know it, type it in`,
  "readout-time-unknown": ({ why }) => `this clip does not show its readout time (${why})`,
  "too-few-frames": ({ frames }) => `${count(frames, "frame is", "frames are")} too few to show it`,
  "shook-too-fast": () => "the camera shook faster than frames were taken",
  "too-even": () => "the camera moved too evenly, or there was too little to follow",
  "imprecise": ({ evidence, value, error }) => `${evidence} give ${value.toFixed(2)} ± ${error.toFixed(2)}`,
  "no-angles-or-motion": () => "the frames show no right angles, or barely move from side to side",
  "parts-disagree": ({ ratios }) => `parts of the clip disagree: ${ratios}`,
  "film-too-short": () => "the film inside it is too short",
  "film-differs": () => "the film inside it shows something else",
  "film-stabilised": () => "the film inside it is stabilised",
  "gyro-too-calm": () => "the camera hardly turned: the clip does not show which moment of its gyro log is which",
  "gyro-too-short": () => "the gyro log ends before the clip, or has gaps",
  "gyro-disagrees": ({ correlation }) =>
    `the picture does not follow the gyro log (correlation ${correlation.toFixed(2)}): the clip was stabilised, or the log is of another clip`,
  "no-clear-part": ({ frames }) => `no ${frames} frames in a row show one scene clearly`,
};

export const words = {
  add: "Add photos or clips…",
  saveAll: "Save all (zip)",
  saveFolder: "Save all to the folder",
  cancel: "Cancel",
  emptyTitle: "Drop photos or clips here",
  emptyWords: "Photos taken from a train, a car or a moving hand lean and bend, since a camera reads its picture row by "
    + "row. unshutter straightens them. A photo that gives no clear answer is left unchanged, and you can help by hand.",
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
  zoom: "100 %",
  zoomHelp: "One pixel of the photo for each pixel of the screen, and back (key Z)",
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
  filterOf: { all: (n) => `All ${n}`, changed: (n) => `Straightened ${n}`, look: (n) => `Please look ${n}`, failed: (n) => `Failed ${n}` },
  allDone: "Looked through",
  doneOf: (done, total) => `${done} of ${total} looked through`,

  // states of a photo
  waiting: "waiting",
  loading: (share) => `loading ${percent(share)}`,
  finding: "finding the motion…",
  drawing: "drawing at full size…",
  failed: "cannot be used",
  changed: (sure) => (sure ? `straightened, ${sure}` : "straightened"),
  changedByHand: "straightened by hand",
  sure: { sure: "sure", likely: "likely", unsure: "unsure" },
  sureAtLength: { sure: "sure", likely: "likely", unsure: "unsure, please look" },
  confidence: (sure) => `Confidence ${percent(sure)}`,
  alone: "left unchanged",

  clipState: { finding: "looking at the motion…", opened: "ready", asking: "needs its readout time", done: "ready to save" },

  // what was done
  done: "What was done",
  moved: (px) => `Straightened: some places moved by up to ${pixels(px)}.`,
  movedByHand: (px) => `Straightened by hand: some places moved by up to ${pixels(px)}.`,
  // of a result with code and figures; a code of a later program keeps the program's sentence
  why: ({ code, figures, reason, confidence }) => {
    const line = reasons[code]?.(figures) ?? reason;
    const bare = ["no-motion", "no-visible-motion", "too-small"].includes(code); // whose figures lack the confidence
    return bare && typeof confidence === "number" ? `${line} (confidence ${percent(confidence)})` : line;
  },
  leftAlone: (reason) => `Left unchanged: ${reason}.`,
  youLeftAlone: "Left unchanged, as you asked.",
  nothingChanged: "There is nothing to save: the photo is unchanged.",

  sentence: (line) => `${line[0].toUpperCase()}${line.slice(1)}.`,

  // a photo that was left unchanged, and what may help
  declined: (reason) => `Left unchanged: ${reason}.`,
  adviceMoving: "Was the camera moving? Try",
  adviceAnyway: "Straighten it even if that is not sure",
  adviceNeighbour: "Add a neighbour frame…",
  adviceByHand: "By hand…",
  neighbourRefused: (reason) => `The neighbour frame cannot be used: ${reason}. The photo was looked at alone.`,
  adviceNeighbours: "Change the neighbour frames…",
  adviceLeaveNeighbours: "Leave them out",

  // what else the motion of a photo could be
  candidates: "What it could be",
  candidate: ({ kind, direction }) => kind === "pan"
    ? { left: "pan to the left", right: "pan to the right", up: "pan upwards", down: "pan downwards" }[direction]
    : { still: "as it is", hand: "hand shake", quadratic: "uneven motion", other: "motion" }[kind],
  candidateFigures: ({ largest_px: px, probability: share }) =>
    [px < LEAST_PX ? "" : pixels(px), share === null ? "" : probability(share)].filter(Boolean).join(" · "),
  candidateHelp: "How far places would move, and how probable it is that the camera moved like that (not how exact the answer is)",
  candidateLabel: (name, figures) => `Take it: ${name}${figures ? ` (${figures})` : ""}`,

  // by hand
  byHand: "By hand",
  byHandHelp: "Draw lines along things in the photo, or set the numbers.",
  drawLine: { upright: "Upright line", level: "Level line", straight: "Bent edge" },
  drawHelp: {
    upright: "Drag along something that stands upright: a corner of a house, a lamp post. Two or more are best.",
    level: "Drag along something level: a sill, a row of windows, a kerb. What faces you tells most.",
    straight: "Drag from end to end of something straight that looks bent, then pull the middle onto it.",
  },
  drawDone: "Press the button again, or Escape, to see what came out.",
  lineOf: { upright: "upright line", level: "level line", straight: "bent edge" },
  lineEnd: (line, number, end) => `Point ${end} of line ${number}, ${line}`,
  lineRemove: (line, number) => `Remove ${line} ${number}`,
  slider_: { lean: "Lean [°]", bend: "Bend [% of height]", turn: "Turn [°]" },
  resetHand: "Undo what I did by hand",
  edgesCrop: (whole) => `Cut down to ${percent(whole)} of its area, so that no empty corners are left.`,
  edgesKeep: (whole) => "Corners that the photo did not see stay empty"
    + (whole === null ? "." : `: cutting them off would leave ${percent(whole)} of it.`),
  edgesFill: "Corners that the photo did not see are filled with a mirror image of the photo.",
  edgesBorrow: "Corners that the photo did not see are borrowed from its neighbours.",
  heldSo: (roll, tilt, from) => {
    const parts = [];
    if (roll !== null) parts.push(`turned ${Math.abs(roll).toFixed(1)}° ${roll < 0 ? "anticlockwise" : "clockwise"}`);
    if (tilt !== null) parts.push(`tilted ${Math.abs(tilt).toFixed(1)}° ${tilt < 0 ? "down" : "up"}`);
    return `The camera was held ${parts.join(" and ")} (${from === "given" ? "as you say" : from}).`;
  },
  exposed: (s) => `Each row was exposed for ${s < 0.3 ? `1/${Math.round(1 / s)}` : s.toFixed(1)} s.`,

  // controls
  settings: "Corrections",
  strength: "Strength [%]",
  strengthNumber: "Strength in per cent",
  advanced: "Advanced",

  // of options that the program describes: labels, choices and help where there are better words for the page
  usual: "as usual",
  option: {
    estimator: "Method", "focal-px": "Focal length [px]", "exposure-s": "Exposure time [s]", "readout-ms": "Readout time [ms]",
    "no-film": "Do not use the film inside the photo", quality: "Quality, 1 to 100", subsampling: "Colour resolution",
    fps: "Frames per second", codec: "Encoder", crf: "Quality (smaller is better)", preset: "Speed of the encoder",
  },
  choices: {
    edges: { auto: "automatic", keep: "keep", crop: "cut off", fill: "fill", borrow: "borrow from neighbours" },
    format: { "": "like the original", jpeg: "JPEG", png: "PNG", webp: "WebP", tiff: "TIFF", avif: "AVIF" },
    model: { "": "as the frames show", camera: "alike: only the camera turned", dense: "differently" },
    subsampling: { "": "like the original" },
    "clip-edges": { fill: "fill", keep: "keep black", crop: "cut off", borrow: "borrow from neighbours" },
  },
  help: { moving: "In a train, on a car, on a drone: motion is likely." },

  edges: "Empty corners",
  reference: "As it was when this row was read",
  referenceOf: { first: "first", middle: "middle", last: "last" },
  moving: "The camera was moving",
  anyway: "Straighten it even if that is not sure",
  leave: "Leave this photo alone",
  readout: "The sensor was read",
  readoutHelp: "Only if a program has turned or mirrored the file.",
  readoutOf: { auto: "as usual", down: "downwards", up: "upwards", right: "to the right", left: "to the left" },
  attitude: "How the camera was held",
  attitudeHelp: "The surest way to tell a leaning building from a tilted camera.",
  "roll-deg": "Turned clockwise [°]",
  "tilt-deg": "Tilted up [°]",
  neighbours: "Taken just before or after",
  neighboursHelp: "A frame of the same burst or clip shows more than the photo alone: near and far may move differently.",
  neighbourOf: { before: "Taken before…", after: "Taken after…" },
  neighbourIs: { before: (name) => `Before: ${name}`, after: (name) => `After: ${name}` },
  neighbourForget: "Leave it out",
  "readout-ratio": "Readout time / time from frame to frame",
  ratioHelp: "Between 0 and 1, if you know it; else the program looks for it.",
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
    ["← →", "move the divider, if it is selected"],
    ["J, K", "next, previous photo"],
    ["+ −, wheel, pinch", "zoom"],
    ["1, 2, 3 …", "what it could be: take one"],
    ["Z", "100 %, and back"],
    ["O", "hold: the original"],
    ["L", "lines that the program measures"],
    ["G", "grid"],
    ["F", "full screen"],
    ["S", "save this photo"],
  ],

  // clips
  moments: "Moments of the clip",
  momentAt: (time) => `The clip at ${time}`,
  time: (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`,
  play: "Play before and after",
  pause: "Pause",
  playAt: "Place in the film",
  filming: "Making a short film of the seconds around this moment…",
  saveClip: "Save this clip",
  clipMoved: (px) => `At this moment, some places moved by up to ${pixels(px)}.`,
  clipAlone: (reason) => `This moment is left unchanged${reason ? `: ${reason}` : ""}.`,
  clipStrength0: "The clip is left unchanged, as you asked.",
  clipCrop: "When the clip is saved, all frames are cut down to what every one of them saw.",
  clipIs: (time, width, height, fps) => `The clip: ${time} long, ${width} × ${height} px, ${Number(fps.toFixed(2))} frames a second.`,
  sayReadout: "If you know how long your camera takes to read out a frame, type it in below.",
  readoutTime: "Readout time",
  readoutTimeOf: { find: "find it", camera: "that of a camera", ms: "in milliseconds", ratio: "as a share" },
  camera: "Camera (type to search)",
  readoutTimeHelp: "How long the camera takes to read out one frame. A clip in which the camera moves unevenly for two "
    + "seconds shows it.",
  readoutValueOf: { ms: "Milliseconds", ratio: "Share of the time from frame to frame" },
  readoutListed: ({ ms, plausible_ms: range, cameras }) => range === null
    ? `${ms.toFixed(1)} ms, from the table of cameras (${cameras}).`
    : `The clip does not show it. ${ms.toFixed(1)} ms is usual for ${cameras} (${range[0].toFixed(1)} to ${range[1].toFixed(1)} ms).`,
  readoutInFile: (ms) => `${ms.toFixed(1)} ms, from the clip's file.`,
  readoutEstimated: (ms, sd) => `Found: ${ms.toFixed(1)} ± ${sd.toFixed(1)} ms.`,
  partOf: "Only a part",
  start: "From [seconds]",
  end: "To [seconds]",
  clipToAll: "Use these settings for all clips",
  clipToAllDone: "All clips have these settings now.",
  making: ({ name, what, done, total }) => {
    const doing = { looking: "looking for what all frames saw", "readout time": "finding the readout time" }[what];
    if (what === "waiting" || !done) return `${name}: ${doing ?? "waiting"}…`;
    return doing ? `${name}: ${doing}…` : `${name}: frame ${done} of ${total}`;
  },
  clipSaved: ({ name, frames, rectified, left_out: lost }, folder) =>
    `${name}: saved${folder ? ` to ${folder}` : ""}, ${rectified} of ${count(frames, "frame", "frames")} straightened`
    + `${rectified < frames ? ", the others left unchanged" : ""}.${lost.length ? ` Such a file has no place for ${lost.join(", ")}.` : ""}`,
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
  saving: (done, total) => `Saving: ${done} of ${count(total, "file", "files")}`,
  fetching: "Fetching the file…",
  saved: (n, failed, folder) =>
    `${count(n, "file", "files")} saved${folder ? ` to ${folder}` : ""}`
    + (failed.length ? `; not saved: ${failed.map((each) => `${each.name} (${each.error})`).join(", ")}` : "."),
  cancelled: (n, folder) => `Cancelled${folder && n ? `: ${count(n, "file is", "files are")} in the folder` : ""}.`,
  nothingToSave: "There is nothing to save yet.",

  // what goes wrong
  tooLarge: (name, mb) => `${name} is larger than ${mb} MB, the limit set by --max-mb.`,
  gone: "unshutter does not answer. Is it still running? This page goes on as soon as it is back.",
  oldLink: "This link is not valid (any more): open the one that “unshutter serve” has printed.",
  error: (name, line) => `${name}: ${line}`,
};

// Puts the words where index.html names them.
export function fill(root) {
  for (const node of root.querySelectorAll("[data-word]")) node.prepend(words[node.dataset.word]);
  for (const node of root.querySelectorAll("[data-label]")) {
    node.setAttribute("aria-label", words[node.dataset.label]);
    if (node instanceof HTMLButtonElement) node.title = words[node.dataset.label];
  }
}
