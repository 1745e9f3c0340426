// A first picture of a file, which the browser draws by itself before the program has answered.

import { make } from "./nodes.js";

const SIDE = 1000; // px, of the longer side
const MOST_BYTES = 50e6; // of a photo: the browser decodes all of it
const PATIENCE_MS = 30_000;

/** @typedef {{ blob: Blob, width: number, height: number }} Glimpse the size is that of the file's picture [px] */

/**
 * A photo, or the frame in the middle of a clip; null: the browser cannot read such files.
 * @param {File} file @param {boolean} isClip @returns {Promise<Glimpse | null>}
 */
export async function glimpse(file, isClip) {
  if (!isClip && file.size > MOST_BYTES) return null;
  try {
    const picture = await (isClip ? middleFrame(file) : createImageBitmap(file));
    const { width, height } = picture;
    const scale = Math.min(SIDE / Math.max(width, height), 1);
    const canvas = new OffscreenCanvas(Math.max(width * scale, 1), Math.max(height * scale, 1));
    canvas.getContext("2d")?.drawImage(picture, 0, 0, canvas.width, canvas.height);
    picture.close();
    return { blob: await canvas.convertToBlob({ type: "image/jpeg" }), width, height };
  } catch {
    return null;
  }
}

/** @param {File} file */
async function middleFrame(file) {
  const video = make("video", { src: URL.createObjectURL(file), preload: "auto" });
  try {
    await heard(video, "loadeddata");
    video.currentTime = video.duration / 2;
    await heard(video, "seeked");
    return await createImageBitmap(video);
  } finally {
    URL.revokeObjectURL(video.src);
  }
}

/** @param {HTMLVideoElement} video @param {string} event */
const heard = (video, event) =>
  new Promise((done, failed) => {
    video.addEventListener(event, done, { once: true });
    video.addEventListener("error", failed, { once: true });
    setTimeout(failed, PATIENCE_MS);
  });
