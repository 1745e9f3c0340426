// Buttons, and other things that panels have in common. A button is declared where it is used, by its name, and has its
// words in words.js: nowhere else.

/** @import { Attributes, Part } from "./types.js" @import { Word } from "./words.js" */

import { make } from "./nodes.js";
import { words } from "./words.js";

/** @typedef {(event: MouseEvent) => unknown} Clicked */

/**
 * A button, one of several that are made alike.
 * @param {string} id @param {string} text @param {Clicked} clicked @param {Attributes} [more]
 */
export const press = (id, text, clicked, more = {}) =>
  make("button", { type: "button", id, onclick: clicked, ...more }, text);

/** A button: its name is its id and its word. @param {Word} name @param {Clicked} clicked @param {Attributes} [more] */
export const button = (name, clicked, more) => press(name, words[name], clicked, more);

/** A button with a sign on it: its word is its title. @param {Word} name @param {Part} sign @param {Clicked} clicked */
export const signed = (name, sign, clicked) =>
  make("button", { type: "button", id: name, title: words[name], "aria-label": words[name], onclick: clicked }, sign);

/** @param {Part[]} parts */
export const row = (...parts) => make("div.row", ...parts);
/** @param {string} [text] */
export const quiet = (text = "") => make("p.quiet", text);

/** A section that can be opened. @param {Word} name @param {Attributes} more @param {Part[]} parts */
export const section = (name, more, ...parts) => make("details.section", more, make("summary", words[name]), ...parts);

/**
 * A list to choose from: its label, and the element in it.
 * @param {string} id @param {string} label @param {Record<string, string>} said
 * @param {(value: string) => void} changed
 */
export function select(id, label, said, changed) {
  const choices = Object.entries(said).map(([value, text]) => make("option", { value }, text));
  const field = make("select", { id, onchange: () => changed(field.value) }, ...choices);
  return { node: make("label.field", { for: id }, label, field), field };
}

/** @param {string} id @param {string} label @param {(on: boolean) => void} changed */
export function check(id, label, changed) {
  const field = make("input", { type: "checkbox", id, onchange: () => changed(field.checked) });
  return { node: make("label.check", field, label), field };
}

/**
 * A number: what lies beyond its limits becomes the nearest that can be; changed hears "" where there is none.
 * @param {string} id @param {Part} label @param {Attributes} limits @param {(value: string) => void} changed
 */
export function number(id, label, limits, changed) {
  const onchange = () => changed((field.value = nearest(field)));
  const field = make("input", { type: "number", id, ...limits, onchange });
  return { node: make("label.field", { for: id }, label, field), field };
}

/** @param {HTMLInputElement} field of a number @returns {string} */
function nearest({ value, min, max, step }) {
  if (value === "") return "";
  const within = Math.min(Math.max(Number(value), Number(min || -Infinity)), Number(max || Infinity));
  return String(step === "1" ? Math.round(within) : within);
}

/** The keys of a panel. @param {string[][]} list */
export function keys(list) {
  const rows = list.flatMap(([key, what]) => [make("dt", key), make("dd", what)]);
  return make("details", make("summary", words.keys), make("dl", ...rows));
}
