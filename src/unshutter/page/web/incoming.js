// Photos and clips on their way in: dropped, pasted or chosen; folders are looked through.

import { wake } from "./api.js";
import { by } from "./nodes.js";

// Calls back with the files, whichever way they come.
export function watch(take) {
  const page = document.documentElement;
  for (const name of ["dragenter", "dragover"]) {
    page.addEventListener(name, (event) => {
      event.preventDefault();
      page.classList.add("dropping");
      wake();
    });
  }
  page.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) page.classList.remove("dropping");
  });
  page.addEventListener("drop", async (event) => {
    event.preventDefault();
    page.classList.remove("dropping");
    take(await dropped(event.dataTransfer));
  });
  document.addEventListener("paste", (event) => {
    if (event.clipboardData.files.length) take([...event.clipboardData.files]);
  });
  by("choose").addEventListener("change", (event) => {
    take([...event.target.files]);
    event.target.value = ""; // so that the same file can be chosen again
  });
  for (const name of ["pointerdown", "focus"]) addEventListener(name, wake);
}

async function dropped(data) {
  const entries = [...data.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.some((entry) => entry.isDirectory)) return [...data.files];
  const files = await Promise.all(entries.map(filesIn));
  return files.flat().filter((file) => !file.name.startsWith("."));
}

async function filesIn(entry) {
  if (entry.isFile) return [await new Promise((done, failed) => entry.file(done, failed))];
  const reader = entry.createReader();
  const files = [];
  for (;;) {
    const some = await new Promise((done, failed) => reader.readEntries(done, failed)); // at most a hundred at a time
    if (!some.length) return files;
    for (const each of some) files.push(...(await filesIn(each)));
  }
}
