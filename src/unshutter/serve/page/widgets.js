// Controls that the panels of photos and clips have in common.

import { make } from "./nodes.js";
import { words } from "./words.js";

export const button = (word, clicked, kind = "", prefix = "do") =>
  make("button", { type: "button", id: `${prefix}-${word}`, class: kind, onclick: clicked }, words[word]);

// A list to choose from: its label, and the element in it.
export function select(id, label, said, changed) {
  const choices = Object.entries(said).map(([value, text]) => make("option", { value }, text));
  const field = make("select", { id, onchange: () => changed(field.value) }, ...choices);
  return { node: make("label", { class: "field", for: id }, label, field), field };
}

export function check(id, label, changed, help) {
  const field = make("input", { type: "checkbox", id, onchange: () => changed(field.checked) });
  return { node: make("label", { class: "check", title: help }, field, label), field };
}

// A number; changed only hears of those that can be.
export function number(id, label, limits, changed) {
  const field = make("input", { type: "number", id, ...limits, onchange: () => field.checkValidity() && changed(field.value) });
  return { node: make("label", { class: "field", for: id }, label, field), field };
}

// How much of the motion to undo; changed hears the option's text.
export function strength(id, changed) {
  const field = make("input", { type: "range", id, min: "0", max: "100", step: "5" });
  const said = make("output", { for: id });
  const say = () => (said.textContent = `${field.value} %`);
  field.addEventListener("input", () => {
    say();
    changed(field.value === "100" ? "" : String(field.value / 100));
  });
  const show = (options) => {
    field.value = Math.round(100 * (options.strength ?? 1));
    say();
  };
  return { nodes: [make("label", { class: "field", for: id }, words.strength, said), field], field, show };
}

// The row at whose moment the picture is taken; usual: the default.
export function reference(name, usual, changed) {
  const radios = Object.keys(words.referenceOf).map((value) =>
    make("input", { type: "radio", name, value, onchange: () => changed(value === usual ? "" : value) }));
  const labels = radios.map((radio) => make("label", {}, radio, words.referenceOf[radio.value]));
  const node = make("fieldset", {}, make("legend", {}, words.reference), make("div", { class: "row" }, ...labels));
  return { node, show: (options) => radios.forEach((radio) => (radio.checked = radio.value === (options.reference ?? usual))) };
}

export function keys(list) {
  const rows = list.map(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]).flat();
  return make("details", {}, make("summary", {}, words.keys), make("dl", {}, ...rows));
}
