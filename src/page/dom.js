// Makes elements. Strings enter as text and as attributes, never as markup.

const SVG = "http://www.w3.org/2000/svg";

/**
 * Sets attributes; those that are undefined or false are taken away, true is the empty string.
 * @template {Element} E
 * @param {E} element
 * @param {Record<string, string | number | boolean | undefined>} attributes
 * @returns {E}
 */
export function setAttributes(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === false) element.removeAttribute(name);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  return element;
}

/**
 * @template {keyof HTMLElementTagNameMap} N
 * @param {N} name
 * @param {Record<string, string | number | boolean | undefined>} [attributes]
 * @param {...(Node | string)} children
 * @returns {HTMLElementTagNameMap[N]}
 */
export function html(name, attributes = {}, ...children) {
  const made = setAttributes(document.createElement(name), attributes);
  made.append(...children);
  return made;
}

/**
 * @template {keyof SVGElementTagNameMap} N
 * @param {N} name
 * @param {Record<string, string | number | boolean | undefined>} [attributes]
 * @param {...(Node | string)} children
 * @returns {SVGElementTagNameMap[N]}
 */
export function svg(name, attributes = {}, ...children) {
  const made = setAttributes(document.createElementNS(SVG, name), attributes);
  made.append(...children);
  return made;
}

/**
 * The element with an id, of the expected class.
 * @template {Element} E
 * @param {string} id
 * @param {new () => E} kind
 * @returns {E}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`the page has no #${id}`);
  return found;
}

/** A number for people, with a true minus sign. @param {number} value @param {number} digits */
export function signed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text.replace("-", "\u2212");
}

/** A number of so many digits for people, without a power of ten where it is large. @param {number} value @param {number} digits */
export const brief = (value, digits) => String(Number(value.toPrecision(digits)));
