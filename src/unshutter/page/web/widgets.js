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

export function check(id, label, changed) {
  const field = make("input", { type: "checkbox", id, onchange: () => changed(field.checked) });
  return { node: make("label", { class: "check" }, field, label), field };
}

// A number; changed only hears of those that can be.
export function number(id, label, limits, changed) {
  const field = make("input", {
    type: "number",
    id,
    ...limits,
    onchange: () => field.checkValidity() && changed(field.value),
  });
  return { node: make("label", { class: "field", for: id }, label, field), field };
}

// Words to type; of known ones, the browser offers those that contain what was typed.
export function text(id, label, known, changed) {
  const list = make("datalist", { id: `${id}-known` }, ...known.map((value) => make("option", { value })));
  const field = make("input", {
    type: known.length ? "search" : "text",
    id,
    list: known.length ? list.id : null,
    autocomplete: "off",
    onchange: () => changed(field.value.trim()),
  });
  return { node: make("label", { class: "field", for: id }, label, field, list), field };
}

// How much of the motion to undo, as the program describes it; changed hears the option's text, and whether the slider is being dragged.
export function strength(id, { maximum, default: usual }, changed) {
  const most = String(100 * maximum);
  const field = make("input", { type: "range", id, min: "0", max: most, step: "5" });
  const number = make("input", {
    type: "number",
    id: `${id}-number`,
    min: "0",
    max: most,
    step: "1",
    "aria-label": words.strengthNumber,
  });
  const say = (value, dragged) => changed(Number(value) === 100 * usual ? "" : String(value / 100), dragged);
  field.addEventListener("input", () => {
    number.value = field.value;
    say(field.value, true);
  });
  field.addEventListener("change", () => say(field.value, false));
  number.addEventListener("change", () => {
    if (number.value === "" || !number.checkValidity()) return;
    field.value = number.value;
    say(number.value, false);
  });
  const show = (options) => {
    const value = Math.round(100 * (options.strength ?? usual));
    if (document.activeElement !== field) field.value = value;
    if (document.activeElement !== number) number.value = value;
  };
  return {
    nodes: [make("label", { class: "field", for: id, title: words.help.strength }, words.strength, number), field],
    field,
    show,
  };
}

// The row at whose moment the picture is taken, as the program describes it.
export function reference(name, { enum: values, default: said, description }, changed) {
  const usual = said ?? values[0];
  const radios = values.map((value) =>
    make("input", { type: "radio", name, value, onchange: () => changed(value === usual ? "" : value) }),
  );
  const labels = radios.map((radio) => make("label", {}, radio, words.referenceOf[radio.value]));
  const node = make(
    "fieldset",
    { title: description },
    make("legend", {}, words.reference),
    make("div", { class: "row" }, ...labels),
  );
  return {
    node,
    show: (options) => radios.forEach((radio) => (radio.checked = radio.value === (options.reference ?? usual))),
  };
}

export function keys(list) {
  const rows = list.flatMap(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]);
  return make("details", {}, make("summary", {}, words.keys), make("dl", {}, ...rows));
}
