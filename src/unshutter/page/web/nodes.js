// Elements, made in one line.

const SVG = "http://www.w3.org/2000/svg";

const put = (node, attributes, children) => {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean") node.toggleAttribute(name, value);
    else if (value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
};

export const make = (name, attributes = {}, ...children) => put(document.createElement(name), attributes, children);
export const draw = (name, attributes = {}, ...children) =>
  put(document.createElementNS(SVG, name), attributes, children);
// Fills a node with others, unless it has the like already: what is under a pressed pointer must not be taken away.
export function refill(node, children) {
  const html = (nodes) => nodes.map((each) => each.outerHTML).join("");
  if (html([...node.children]) !== html(children)) node.replaceChildren(...children);
}

// Puts the words where index.html names them.
export function fill(root, words) {
  for (const node of root.querySelectorAll("[data-word]")) node.prepend(words[node.dataset.word]);
  for (const node of root.querySelectorAll("[data-label]")) {
    node.setAttribute("aria-label", words[node.dataset.label]);
    if (node instanceof HTMLButtonElement) node.title = words[node.dataset.label];
  }
}

const KEPT_OF_NAME = 9; // characters at its end, with its number and extension

// A file's name in two parts: where there is no room, its middle gives way.
export const nameParts = (name) => [
  make("span", { class: "start" }, name.slice(0, -KEPT_OF_NAME)),
  make("span", {}, name.slice(-KEPT_OF_NAME)),
];

export const by = (id) => document.getElementById(id);
