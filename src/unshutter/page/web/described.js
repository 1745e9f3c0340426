// Controls made from the program's description of its options (options.js): choices, defaults, limits and help.

import { clip, photo } from "./options.js";
import { check, number, select, text } from "./widgets.js";
import { words } from "./words.js";

const OPTIONS = { photo, clip };
const readable = (name) => `${name[0].toUpperCase()}${name.slice(1).replaceAll("-", " ")}`;

// The label of an option in a sentence; the program's own options have none.
export const labelOf = (name) => (photo[name] || clip[name] ? `“${label(name)}”` : `--${name}`);
const label = (name) => [words[name], words.option[name]].find((each) => typeof each === "string") ?? readable(name);

// What the program says of an option of a photo or clip.
export const about = (kind, name) => OPTIONS[kind][name];

// The names of the options that belong to some groups.
export const ofGroups = (kind, groups) =>
  Object.keys(OPTIONS[kind]).filter((name) => groups.includes(OPTIONS[kind][name].group));

// A control for an option; changed(name, text) hears "" for its default; show(options) brings it up to date.
export function control(kind, name, id, changed, said = words.choices[name]) {
  const schema = about(kind, name);
  const usual = String(schema.default ?? "");
  const set = (value) => changed(name, String(value) === usual ? "" : value);
  const made = widget(schema, id, label(name), set, said);
  made.node.title = words.help[name] ?? schema.description;
  const show = (options) => {
    const value = options[name] ?? usual;
    if (made.field.type === "checkbox") made.field.checked = value === "true";
    else if (document.activeElement !== made.field || schema.enum) made.field.value = value;
  };
  return { ...made, show };
}

function widget(schema, id, label, set, said = {}) {
  if (schema.type === "boolean") return check(id, label, set);
  if (schema.type !== "string") {
    const { minimum: min, maximum: max } = schema;
    return number(id, label, { min, max, step: schema.type === "integer" ? "1" : "any" }, set);
  }
  if (!schema.enum) return text(id, label, schema.examples, set);
  const values = schema.default === undefined ? ["", ...schema.enum] : schema.enum;
  return select(
    id,
    label,
    Object.fromEntries(values.map((value) => [value, said[value] ?? (value || words.usual)])),
    set,
  );
}

// Controls for the options of some groups that have no place of their own on the panel; groups: null: of any.
export function others(kind, placed, groups, prefix, changed) {
  const names = Object.keys(OPTIONS[kind]).filter(
    (name) => !placed.includes(name) && (!groups || groups.includes(about(kind, name).group)),
  );
  return names.map((name) => control(kind, name, `${prefix}${name}`, changed));
}
