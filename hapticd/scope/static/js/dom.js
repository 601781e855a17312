// The few things every part of the page does with the document. Texts go in as text only, never as markup.
// @ts-check

/**
 * The element with this id.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} [kind]
 * @returns {T}
 */
export function byId(id, kind) {
  const found = document.getElementById(id);
  if (!found || (kind && !(found instanceof kind))) throw new Error(`the page has no #${id}`);
  return /** @type {T} */ (found);
}

/**
 * A new element.
 * @param {string} tag
 * @param {Record<string, string>} attributes
 * @param {(Node | string)[]} children
 * @returns {HTMLElement}
 */
export function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/**
 * A new SVG element.
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {string} [text]
 * @returns {SVGElement}
 */
export function svg(tag, attributes = {}, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  if (text !== undefined) made.textContent = text;
  return made;
}

/** Set an element's text if it differs, so that a screen reader is not told twice. @param {string} id @param {string} text */
export function say(id, text) {
  const place = byId(id);
  if (place.textContent !== text) place.textContent = text;
}

/** Say what a click on a button means now; one that is pressed at this moment keeps what it said. @param {HTMLButtonElement} button @param {string} value @param {string} text */
export function mean(button, value, text) {
  if (button.matches(":active")) return;
  button.value = value;
  button.textContent = text;
}

/** A number to so many significant digits. @param {number | null | undefined} value @param {number} digits */
export function number(value, digits = 4) {
  if (value === null || value === undefined) return "∞";
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "–" : "∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return Number(value.toPrecision(digits)).toExponential();
  return String(Number(value.toPrecision(digits)));
}

/** A time in the unit that suits it. @param {number} seconds */
export function duration(seconds) {
  const size = Math.abs(seconds);
  if (!Number.isFinite(seconds)) return "–";
  if (size < 1e-3) return `${number(seconds * 1e6, 3)} µs`;
  if (size < 1) return `${number(seconds * 1e3, 3)} ms`;
  return size < 120 ? `${number(seconds, 3)} s` : `${number(seconds / 60, 3)} min`;
}

/** A setting of a config by its dotted key. @param {any} config @param {string} key */
export const lookUp = (config, key) => key.split(".").reduce((found, part) => found?.[part], config);
