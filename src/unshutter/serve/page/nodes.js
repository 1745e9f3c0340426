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
export const by = (id) => document.getElementById(id);
