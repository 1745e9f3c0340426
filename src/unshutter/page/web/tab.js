// This tab shows the program that it is open, and takes the files with which it was opened.

import { ask, events, Refused, rest } from "./api.js";

const EVERY_MS = 5000; // between tries; the program waits twice as long for a tab
const TABS = "/api/tabs";

/** The id that the link gave this tab; a page that is loaded again has none. */
function takeId() {
  const address = new URL(location.href);
  const id = address.searchParams.get("open");
  address.searchParams.delete("open");
  history.replaceState(null, "", address);
  return id;
}

/**
 * Holds a request open until the tab is closed; calls back with files, and with what keeps one from being opened.
 * One tab at a time does so for all, since a browser has only six connections to a server.
 * @param {(files: File[]) => void} take @param {(line: string) => void} refuse
 */
export async function keepOpen(take, refuse) {
  const id = takeId();
  if (id !== null) openFiles(`${TABS}/${id}/files`, take, refuse).catch(() => {});
  for (;;) {
    await navigator.locks?.request("tab", hold).catch(() => {}); // the page says why, in other places
    await rest(EVERY_MS);
  }
}

async function hold() {
  for await (const _ of events(TABS)); // which has none: it ends with the program
}

/** @param {string} address @param {(files: File[]) => void} take @param {(line: string) => void} refuse */
async function openFiles(address, take, refuse) {
  /** @type {string[]} */
  const names = await (await ask(address)).json();
  const files = [];
  for (const [number, name] of names.entries()) {
    try {
      const answer = await ask(`${address}/${number}`);
      files.push(new File([await answer.blob()], name));
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refuse(`${name}: ${error.message}`);
    }
  }
  if (files.length) take(files);
}
