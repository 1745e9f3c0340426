// Elements, made in one line.

/** @import { Made, Part } from "./types.js" */

const SVG = "http://www.w3.org/2000/svg";

/** @template {Element} T @param {T} node @param {Part[]} parts @returns {T} */
function put(node, parts) {
  for (const part of parts) {
    if (typeof part === "string" || part instanceof Node) node.append(part);
    else for (const [name, value] of Object.entries(part || {})) set(node, name, value);
  }
  return node;
}

/** @param {Element} node @param {string} name @param {any} value */
function set(node, name, value) {
  if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
  else if (typeof value === "boolean" && !name.startsWith("aria-")) node.toggleAttribute(name, value);
  else if (value !== null && value !== undefined) node.setAttribute(name, value);
}

/**
 * An element of a tag and classes, "p.quiet", with its parts: attributes, listeners (on...), children and words.
 * @template {string} S @param {S} selector @param {Part[]} parts
 */
export function make(selector, ...parts) {
  const [tag, ...classes] = selector.split(".");
  const node = document.createElement(tag);
  if (classes.length) node.className = classes.join(" ");
  return /** @type {Made<S>} */ (put(node, parts));
}

/** The like in SVG. @param {string} tag @param {Part[]} parts */
export const draw = (tag, ...parts) => put(document.createElementNS(SVG, tag), parts);

/**
 * Fills a node with others, unless it has the like already: what is under a pressed pointer must not be taken away.
 * @param {Element} node @param {Element[]} children
 */
export function refill(node, children) {
  const html = (/** @type {Element[]} */ nodes) => nodes.map((each) => each.outerHTML).join("");
  if (html([...node.children]) !== html(children)) node.replaceChildren(...children);
}

const KEPT_OF_NAME = 9; // characters at its end, with its number and extension

/**
 * Puts a file's name on a node: where there is no room, its middle gives way. It is drawn in two parts, but is one word
 * for those who hear or search it.
 * @template {HTMLElement} T @param {T} node @param {string} name @returns {T}
 */
export function putName(node, name) {
  Object.assign(node.dataset, { start: name.slice(0, -KEPT_OF_NAME), end: name.slice(-KEPT_OF_NAME) });
  node.replaceChildren(make("span.away", name));
  return node;
}

/** @param {string} id */
export const element = (id) => /** @type {HTMLElement} */ (document.getElementById(id));
