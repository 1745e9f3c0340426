// This tab tells the program that it is open, and takes the files with which it was opened.

import { ask, close, Refused, rest } from "./api.js";

const EVERY_MS = 20000;
const TABS = "/api/tabs";

/** The id that the link gave this tab; without one, the tab makes its own, another each time the page is loaded. */
function takeId() {
  const address = new URL(location.href);
  const given = address.searchParams.get("open");
  if (given === null) return { id: `tab-${Math.random().toString(36).slice(2).padEnd(8, "0")}`, given: false };
  address.searchParams.delete("open");
  history.replaceState(null, "", address);
  return { id: given, given: true };
}

const { id, given } = takeId();

/**
 * Reports until the tab is closed; calls back with files, and with what keeps one from being opened.
 * @param {(files: File[]) => void} take @param {(line: string) => void} refuse
 */
export async function keepOpen(take, refuse) {
  addEventListener("pagehide", () => close(TABS, id));
  const report = async (again = "") => {
    const answer = await ask(`${TABS}/${id}${again}`, { method: "POST" });
    await answer.text(); // a request ends with its answer
  };
  addEventListener("pageshow", (event) => event.persisted && report("?again=1").catch(() => {}));
  if (given) openFiles(take, refuse).catch(() => {});
  for (;;) {
    await report().catch(() => {}); // the page says why, in other places
    await rest(EVERY_MS);
  }
}

/** @param {(files: File[]) => void} take @param {(line: string) => void} refuse */
async function openFiles(take, refuse) {
  /** @type {string[]} */
  const names = await (await ask(`${TABS}/${id}/files`)).json();
  const files = [];
  for (const [number, name] of names.entries()) {
    try {
      const answer = await ask(`${TABS}/${id}/files/${number}`);
      files.push(new File([await answer.blob()], name));
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      refuse(`${name}: ${error.message}`);
    }
  }
  if (files.length) take(files);
}
