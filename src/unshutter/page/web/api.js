// What the page asks of the program. Every request carries the token of the link that opened the page.

/** @import { About, Advised, Refusal } from "./types.js" */

import { labelOf } from "./form.js";

const RETRY_MS = 1000;
const KEY = "unshutter-token";

export class Refused extends Error {
  /** @param {number} status @param {string} line @param {Advised[]} [advice] buttons that may help */
  constructor(status, line, advice = []) {
    super(line);
    this.status = status;
    this.advice = advice;
  }
}

/** The token goes from the address to this tab's memory: not into bookmarks, history or screenshots. */
function takeToken() {
  const address = new URL(location.href);
  const token = address.searchParams.get("token");
  if (token !== null) {
    sessionStorage.setItem(KEY, token);
    address.searchParams.delete("token");
    history.replaceState(null, "", address);
  }
  return token ?? sessionStorage.getItem(KEY) ?? "";
}

const token = takeToken();
const headers = { Authorization: `Bearer ${token}` };
/** @param {number} ms */
export const rest = (ms) => new Promise((done) => setTimeout(done, ms));

/** @typedef {"gone" | "old link" | ""} Health */
/** @type {Set<(health: Health) => void>} */
const watchers = new Set();

/** Calls back whenever it becomes known how the program is. @param {(health: Health) => void} callback */
export const onHealth = (callback) => watchers.add(callback);
/** @param {Health} health */
const tell = (health) => watchers.forEach((callback) => callback(health));

/**
 * Asks, and asks again while the program is busy or gone; raises Refused.
 * @param {string} path @param {RequestInit} [options]
 */
export async function ask(path, options = {}) {
  for (;;) {
    let answer;
    try {
      answer = await fetch(path, { ...options, headers });
    } catch (error) {
      if (isAbort(error)) throw error;
      tell("gone");
      await rest(RETRY_MS);
      continue;
    }
    if (answer.status === 503 || answer.status === 429) {
      await rest(RETRY_MS);
      continue;
    }
    tell(answer.status === 401 ? "old link" : "");
    if (!answer.ok) throw await refusal(answer);
    return answer;
  }
}

/** Whether a question was taken back. @param {unknown} error */
export const isAbort = (error) => error instanceof DOMException && error.name === "AbortError";

/** @param {Response} answer */
async function refusal(answer) {
  try {
    /** @type {Refusal} */
    const told = await answer.json();
    return new Refused(answer.status, told.sentence ?? lineOf(told), told.advice);
  } catch {
    return new Refused(answer.status, `${answer.status} ${answer.statusText}`);
  }
}

/** The line of an error, with the labels of the options that it names. @param {Partial<Refusal>} told */
export const lineOf = ({ error = "", said }) =>
  said?.map((piece, k) => (k % 2 ? labelOf(piece) : piece)).join("") ?? error;

/** The JSON in a header of an answer. @param {Response} answer */
export const factsIn = (answer, name = "Unshutter-Result") => JSON.parse(answer.headers.get(name) ?? "null");

/**
 * Sends a file to an address of the API; fetch would not tell how far it is.
 * @param {string} address @param {File} file @param {(share: number) => void} progress
 * @returns {Promise<string>} its id
 */
export function send(address, file, progress) {
  return new Promise((done, failed) => {
    const request = new XMLHttpRequest();
    request.open("POST", address);
    request.setRequestHeader("Authorization", `Bearer ${token}`);
    request.setRequestHeader("Unshutter-Name", encodeURIComponent(file.name));
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.addEventListener("progress", (event) => progress(event.loaded / (event.total || 1)));
    request.addEventListener("load", () => {
      /** @type {Partial<Refusal> & { id?: string }} */
      let answer = {};
      try {
        answer = JSON.parse(request.responseText);
      } catch {
        // a refusal without words
      }
      tell(request.status === 401 ? "old link" : "");
      if (request.status === 201) done(answer.id ?? "");
      else failed(new Refused(request.status, lineOf(answer) || `${request.status} ${request.statusText}`));
    });
    request.addEventListener("error", () => {
      tell("gone");
      failed(new Refused(0, ""));
    });
    request.send(file);
  });
}

/** @returns {Promise<About>} */
export const about = async () => (await ask("/api/about")).json();

let woken = 0;
/** Loads what the first photo would wait for; asked at the first signs that one is coming. */
export function wake() {
  if (Date.now() - woken < 30000) return;
  woken = Date.now();
  fetch("/api/wake", { method: "POST", headers }).catch(() => {});
}

/** Tells the program that something of an address is needed no more. @param {string} address @param {string} id */
export const close = (address, id) =>
  fetch(`${address}/${id}`, { method: "DELETE", headers, keepalive: true }).catch(() => {});

/** Server-sent events, read with the token in a header. @param {string} path @returns {AsyncGenerator<any>} */
export async function* events(path) {
  const { body } = await ask(path);
  if (!body) return;
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const parts = text.split("\n\n");
    text = parts.pop() ?? "";
    for (const part of parts) if (part.startsWith("data: ")) yield JSON.parse(part.slice(6));
  }
}

/** Hands an answer's file to the browser's downloads; returns its name. @param {Response} answer */
export async function download(answer) {
  const address = URL.createObjectURL(await answer.blob());
  const link = document.createElement("a");
  link.href = address;
  link.download = factsIn(answer, "Unshutter-Name");
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 60000);
  return link.download;
}
