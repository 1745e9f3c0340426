// A first picture of a file, which the browser draws by itself before the program has answered.

import { make } from "./nodes.js";

const SIDE = 1000; // px, of the longer side
const PATIENCE_MS = 8000;

/** @typedef {{ blob: Blob, width: number, height: number }} Glimpse the size is that of the file's picture [px] */

/**
 * A photo, or the frame in the middle of a clip; null: the browser cannot read such files.
 * @param {File} file @param {boolean} isClip @returns {Promise<Glimpse | null>}
 */
export async function glimpse(file, isClip) {
  const address = URL.createObjectURL(file);
  try {
    const picture = await (isClip ? middleFrame(address) : photo(address));
    const [width, height] = "videoWidth" in picture ? [picture.videoWidth, picture.videoHeight] : sizeOf(picture);
    const scale = Math.min(SIDE / Math.max(width, height), 1);
    const canvas = new OffscreenCanvas(Math.max(width * scale, 1), Math.max(height * scale, 1));
    canvas.getContext("2d")?.drawImage(picture, 0, 0, canvas.width, canvas.height);
    return { blob: await canvas.convertToBlob({ type: "image/jpeg" }), width, height };
  } catch {
    return null;
  } finally {
    URL.revokeObjectURL(address);
  }
}

/** @param {string} src */
async function photo(src) {
  const image = make("img", { src });
  await image.decode();
  return image;
}

/** @param {HTMLImageElement} image @returns {[number, number]} */
const sizeOf = ({ naturalWidth, naturalHeight }) => [naturalWidth, naturalHeight];

/** @param {string} src */
async function middleFrame(src) {
  const video = make("video", { src, preload: "auto" });
  await heard(video, "loadeddata");
  video.currentTime = video.duration / 2;
  await heard(video, "seeked");
  return video;
}

/** @param {HTMLVideoElement} video @param {string} event */
const heard = (video, event) =>
  new Promise((done, failed) => {
    video.addEventListener(event, done, { once: true });
    video.addEventListener("error", failed, { once: true });
    setTimeout(failed, PATIENCE_MS);
  });
