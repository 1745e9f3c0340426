// Photos and clips on their way in: dropped, pasted or chosen; folders are looked through.

import { wake } from "./api.js";
import { element } from "./nodes.js";

/** Calls back with the files, whichever way they come. @param {(files: File[]) => void} take */
export function watch(take) {
  const page = document.documentElement;
  const over = (/** @type {DragEvent} */ event) => {
    event.preventDefault();
    page.classList.add("dropping");
    wake();
  };
  page.addEventListener("dragenter", over);
  page.addEventListener("dragover", over);
  page.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) page.classList.remove("dropping");
  });
  page.addEventListener("drop", async (event) => {
    event.preventDefault();
    page.classList.remove("dropping");
    if (event.dataTransfer) take(await dropped(event.dataTransfer));
  });
  document.addEventListener("paste", (event) => {
    if (event.clipboardData?.files.length) take([...event.clipboardData.files]);
  });
  const choose = /** @type {HTMLInputElement} */ (element("choose"));
  choose.addEventListener("change", () => {
    take([...(choose.files ?? [])]);
    choose.value = ""; // so that the same file can be chosen again
  });
  for (const name of ["pointerdown", "focus"]) addEventListener(name, wake);
}

/** @param {DataTransfer} data */
async function dropped(data) {
  const entries = [...data.items]
    .map((item) => item.webkitGetAsEntry?.())
    .filter((entry) => entry !== null && entry !== undefined);
  if (!entries.some((entry) => entry.isDirectory)) return [...data.files];
  const files = await Promise.all(entries.map(filesIn));
  return files.flat().filter((file) => !file.name.startsWith("."));
}

/** @param {FileSystemEntry} entry @returns {Promise<File[]>} */
async function filesIn(entry) {
  if (entry.isFile) {
    const { file } = /** @type {FileSystemFileEntry} */ (entry);
    return [await new Promise((done, failed) => file.call(entry, done, failed))];
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader();
  const files = [];
  for (;;) {
    /** @type {FileSystemEntry[]} at most a hundred at a time */
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) return files;
    for (const each of some) files.push(...(await filesIn(each)));
  }
}
