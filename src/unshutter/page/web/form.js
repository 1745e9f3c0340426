// Controls made from the program's description of its options (options.js): choices, defaults, limits and help. An
// option that no panel places appears by itself, among the others.

/** @import { Control, Kind, Options, Schema } from "./types.js" */

import { ENCODING } from "./encoding.js";
import { make } from "./nodes.js";
import { clip, photo } from "./options.js";
import { check, number, select } from "./widgets.js";
import { words } from "./words.js";

const OPTIONS = { photo, clip };

/** @typedef {(name: string, text: string, dragged?: boolean) => void} Changed hears "" for an option's default */
/** @typedef {(value: string | boolean, dragged?: boolean) => void} Set */
/** @typedef {Omit<Control, "show"> & { show?: (value: string) => void }} Made */

/** The label of an option in a sentence; the program's own options have none. @param {string} name */
export const labelOf = (name) => (name in photo || name in clip ? `“${label(name)}”` : `--${name}`);

/** What the program says of an option. @param {Kind} kind @param {string} name @returns {Schema} */
export const about = (kind, name) => OPTIONS[kind][name];

/** The names of the options that belong to some groups. @param {Kind} kind @param {string[]} groups */
export const ofGroups = (kind, groups) =>
  Object.keys(OPTIONS[kind]).filter((name) => groups.includes(about(kind, name).group));

/** The controls of a panel, or of a section of it. */
export class Form {
  /** @type {Map<string, Control | null>} of each option that has its place; null: in a place of its own */
  #made = new Map();

  /** @param {Kind} kind @param {Changed} changed @param {string[]} elsewhere options that have another place */
  constructor(kind, changed, elsewhere = []) {
    this.kind = kind;
    this.changed = changed;
    for (const name of elsewhere) this.#made.set(name, null);
  }

  /** The control of an option. @param {string} name @param {string} id */
  control(name, id = this.kind === "clip" ? `clip-${name}` : name) {
    const schema = about(this.kind, name);
    const usual = String(schema.default ?? "");
    /** @type {Set} */
    const set = (value, dragged) => this.changed(name, String(value) === usual ? "" : String(value), dragged);
    const { node, field, show } = widget(this.kind, name, schema, id, set);
    node.title = look(words.help, name) ?? schema.description;
    const control = { node, field, show: (/** @type {Options} */ options) => put(options[name] ?? usual) };
    const put = (/** @type {string} */ value) => {
      if (show) show(value);
      else if (field.type === "checkbox") /** @type {HTMLInputElement} */ (field).checked = value === "true";
      else if (document.activeElement !== field || schema.enum) field.value = value;
    };
    this.#made.set(name, control);
    return control;
  }

  /** Controls for the options that have no place yet, of some groups. @param {(group: string) => boolean} wanted */
  rest(wanted = () => true) {
    const prefix = this.kind === "clip" ? "clip-option-" : "option-";
    const names = Object.keys(OPTIONS[this.kind]).filter((name) => wanted(about(this.kind, name).group));
    const others = names.filter((name) => !this.#made.has(name));
    return others.map((name) => ({ name, node: this.control(name, prefix + name).node }));
  }

  /** The field of an option that has its place here. @param {string} name */
  field(name) {
    return /** @type {Control} */ (this.#made.get(name)).field;
  }

  /** Shows what was asked for. @param {Options} options */
  show(options) {
    for (const control of this.#made.values()) control?.show(options);
  }

  /** Takes some options out of use, and gives the others back. @param {(name: string) => boolean} unused */
  disable(unused) {
    for (const [name, control] of this.#made) if (control) control.field.disabled = unused(name);
  }
}

/** @template T @param {Record<string, T>} from @param {string} name @returns {T | undefined} */
const look = (from, name) => from[name];
/** @param {string} name */
const label = (name) => look(words.option, name) ?? `${name[0].toUpperCase()}${name.slice(1).replaceAll("-", " ")}`;

/**
 * @param {Kind} kind @param {string} name @param {Schema} schema @param {string} id @param {Set} set @returns {Made}
 */
function widget(kind, name, schema, id, set) {
  if (name === "reference") return reference(id, schema, set);
  const said = label(name);
  if (name === "stabilize") return steady(id, schema, set);
  if (name === "strength") return strength(id, said, schema, set);
  if (name === "readout-ratio" && kind === "photo") return slider(id, { ...RATIO, label: said, name: said }, set);
  if (ENCODING.includes(name)) return select(id, said, {}, set);
  if (schema.type === "boolean") return check(id, said, set);
  if (schema.type !== "string") {
    const { minimum: min, maximum: max } = schema;
    return number(id, said, { min, max, step: schema.type === "integer" ? "1" : "any" }, set);
  }
  if (!schema.enum) return text(id, said, schema.examples, set);
  const values = schema.default === undefined ? ["", ...schema.enum] : schema.enum;
  const choices = look(words.choices, `${kind}-${name}`) ?? look(words.choices, name);
  const titles = { "": words.usual, ...schema.titles, ...choices };
  const named = values.map((value) => [value, look(titles, value) ?? value]);
  return select(id, said, Object.fromEntries(named), set);
}

/**
 * Words to type; of known ones, the browser offers those that contain what was typed.
 * @param {string} id @param {string} label @param {string[]} known @param {Set} set
 */
function text(id, label, known, set) {
  const list = make("datalist", { id: `${id}-known` }, ...known.map((value) => make("option", { value })));
  const kind = known.length ? { type: "search", list: list.id } : { type: "text" };
  const field = make("input", { ...kind, id, autocomplete: "off", onchange: () => set(field.value.trim()) });
  return { node: make("label.field", { for: id }, label, field, list), field };
}

const RATIO = { limits: { min: "0.01", max: "1", step: "0.01" }, step: "any", usual: "", unit: 1 };

/**
 * How much of the motion to undo, in per cent.
 * @param {string} id @param {string} label @param {Schema} schema @param {Set} set
 */
function strength(id, label, { maximum = 1, default: stated }, set) {
  const limits = { min: "0", max: String(100 * maximum), step: "5" };
  const usual = String(100 * Number(stated));
  return slider(id, { label, name: words.strengthNumber, limits, step: "1", usual, unit: 100 }, set);
}

/**
 * Whether the camera is steadied, and how much: half, once or twice the usual number of seconds.
 * @param {string} id @param {Schema} schema @param {Set} set
 */
function steady(id, { bare = 1 }, set) {
  const said = Object.entries(words.steadyOf).map(([times, text]) => [
    String(bare * Number(times)),
    text(bare * Number(times)),
  ]);
  const much = select(`${id}-seconds`, words.steadyHow, Object.fromEntries(said), set);
  const { node, field } = check(id, words.option.stabilize, (on) => set(on ? much.field.value : ""));
  const show = (/** @type {string} */ value) => {
    field.checked = value !== "";
    much.node.hidden = !value;
    much.field.value = value || String(bare);
  };
  return { node: make("div.steady", node, much.node), field, show };
}

/**
 * A number within limits: a slider, and a field to type it. An option is shown as so many units; an empty field stands
 * for the usual number, if there is one.
 * @typedef {{ min: string, max: string, step: string }} Limits
 * @param {string} id
 * @param {{ label: string, name: string, limits: Limits, step: string, usual: string, unit: number }} how
 * @param {Set} set
 */
function slider(id, { label, name, limits, step, usual, unit }, set) {
  const field = make("input", { type: "range", id, ...limits });
  const say = (/** @type {string} */ value, dragged = false) => set(value && String(Number(value) / unit), dragged);
  const typed = number(`${id}-number`, label, { ...limits, step, "aria-label": name }, (value) => {
    const text = value || usual;
    if (text) field.value = typed.field.value = text;
    say(text);
  });
  typed.node.htmlFor = id;
  field.addEventListener("input", () => say((typed.field.value = field.value), true));
  field.addEventListener("change", () => say(field.value));
  const show = (/** @type {string} */ value) => {
    for (const each of [field, typed.field]) {
      if (value && document.activeElement !== each) each.value = String(Number((unit * Number(value)).toFixed(2)));
    }
  };
  return { node: make("div.strength", typed.node, field), field, show };
}

/** The row at whose moment the picture is taken. @param {string} name @param {Schema} schema @param {Set} set */
function reference(name, { enum: values = [], default: stated = "" }, set) {
  const usual = stated || values[0];
  const changed = (/** @type {string} */ value) => set(value === usual ? String(stated) : value);
  const radios = values.map((value) => make("input", { type: "radio", name, value, onchange: () => changed(value) }));
  const labels = radios.map((radio) => make("label", radio, look(words.referenceOf, radio.value)));
  const node = make("fieldset", make("legend", words.option.reference), make("div.row", ...labels));
  const show = (/** @type {string} */ value) => {
    for (const radio of radios) radio.checked = radio.value === (value || usual);
  };
  return { node, field: radios[0], show };
}
