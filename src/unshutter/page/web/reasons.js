// Why a photo, moment or clip is left unchanged, in English. Part of the words of the page (words.js).

// Numbers as the page writes them.
export const percent = (share) => `${share < 1 ? Math.min(Math.round(100 * share), 99) : Math.round(100 * share)} %`; // as reasons.py
export const pixels = (px) => (px >= 10 ? `${px.toFixed(0)} px` : `${px.toFixed(1)} px`);
export const count = (n, one, many) => (n === 1 ? `1 ${one}` : `${n} ${many}`);

// Code of a reason -> why a photo, moment or clip is left unchanged, with the reason's figures.
export const reasons = {
  stated: ({ sentence }) => sentence,
  "too-long": ({ aspect }) => `one side is more than ${aspect} times as long as the other`,
  "too-few-segments": ({ segments }) => `only ${count(segments, "straight line was", "straight lines were")} found`,
  "no-right-angles": () => "the photo shows no right angles",
  "pose-unknown": () => "the photo does not show how the camera was held",
  "too-askew": ({ deg }) => `not levelled: held askew by ${deg.toFixed(0)}°`,
  "too-steep": ({ deg }) => `not made upright: tilted by ${deg.toFixed(0)}°`,
  "too-fast-for-hands": () => "the lines would mean more motion than a hand-held camera makes",
  "too-sharp": ({ exposure }) => `it is too sharp for a camera that moved during an exposure of ${exposure}`,
  "no-rolling-shutter": () => "this camera exposes all rows at once",
  "film-stood-still": () => "the camera stood still, as the film inside it shows",
  "impossible-motion": ({ detail }) => `no camera moves like that: ${detail}`,
  "asked-for-nothing": () => "that is what you asked for",
  "no-motion": () => "the camera did not move",
  "no-visible-motion": () => "no motion can be seen",
  "strength-0": () => "the strength is 0",
  unsure: ({ confidence }) => `not sure: straightening it would help with a probability of ${percent(confidence)}`,
  "hardly-helps": () => "not sure: the motion that was found is hardly larger than its typical error",
  "unsure-how-moved": ({ confidence }) =>
    `you said that the camera moved, but straightening it by the likeliest motion would help with a probability of only ${percent(confidence)}`,
  "moved-too-little": ({ px }) =>
    `you said that the camera moved, but the motion that fits, up to ${pixels(px)}, is hardly larger than its typical error`,
  "moved-otherwise": () => "you said how the camera moved, but no motion that fits goes that way",
  "unsure-whether-moved": ({ confidence }) => `not sure whether the camera moved (confidence ${percent(confidence)})`,
  "wide-lens": () => "not sure: a wide lens bends lines",
  "which-way": () => "its motion blur shows that the camera moved, but not which way",
  "too-small": () => "nothing would move by as much as half a pixel",
  "stood-still": () => "the camera stood still",
  "nothing-moved": () => "nothing moved between the frames",
  "nothing-to-see": ({ px }) => `nothing to see: at most ${px.toFixed(1)} px at any plausible readout time`,
  "no-visible-distortion": () => "this clip has no visible rolling-shutter distortion",
  "no-gain": ({ before, after }) =>
    `undoing the motion hardly helps: wobble of ${before.toFixed(2)} px before, ${after.toFixed(2)} px after`,
  "hardly-moved": () => "the camera hardly moved",
  "no-common-motion": () => "near and far move too differently for one motion of the camera",
  "only-others-moved": () => "the camera stood still; what moved in front of it is not straightened",
  "no-neighbour": () => "there is no frame before or after it",
  "shot-too-short": () => "the shot is too short to show how the camera moved",
  "other-size": () => "the frames before and after it have another size",
  "too-little-to-follow": () => "there is too little to follow from frame to frame",
  "scenes-differ": () => "its neighbours show another scene, or near and far move too differently in them",
  "frames-disagree": () => "the frames do not show how the camera moved",
  "ratio-unknown": ({ why }) => `the readout time cannot be found from these frames (${why})`,
  "readout-time-unknown": ({ why }) => `this clip does not show its readout time (${why})`,
  "too-few-frames": ({ frames }) => `${count(frames, "frame is", "frames are")} too few to show it`,
  "shook-too-fast": () => "the camera shook faster than frames were taken",
  "too-even": () => "the camera moved too evenly, or there was too little to follow",
  "parts-disagree": ({ ratios }) => `parts of the clip disagree: ${ratios}`,
  "film-too-short": () => "the film inside it is too short",
  "film-differs": () => "the film inside it shows something else",
  "film-stabilised": () => "the film inside it is stabilised",
  "gyro-too-calm": () => "the camera barely turned: the gyro log cannot be aligned with the clip",
  "gyro-too-short": () => "the gyro log ends before the clip, or has gaps",
  "gyro-disagrees": ({ correlation }) =>
    `the picture does not follow the gyro log (correlation ${correlation.toFixed(2)}): the clip was stabilised, or the log belongs to another clip`,
  "gyro-damaged": () => "it is damaged",
  "gyro-unread": () => "reading it needs the extra gyro",
  "stabilised-in-camera": () => "its camera stabilised the clip, so the times of its rows are unknown",
  "no-clear-part": ({ frames }) => `no ${frames} frames in a row show one scene clearly`,
};
