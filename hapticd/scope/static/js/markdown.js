// Markdown of the fault pages as elements: headings, paragraphs, lists, tables, code, emphasis, links. All text goes in as
// text. A link to another fault page opens it; any other leads to the documentation, which is not served here: its words stay.
// @ts-check

import { make } from "./dom.js";

const INLINE = /`([^`]+)`|\*\*(.+?)\*\*|\*(.+?)\*|\[([^\]]+)\]\(([^)\s]+)\)/s;
const ITEM = /^(?:[-*]|\d+\.)\s+/;
const SIBLING = /^([a-z_]+)\.md$/;

/** @param {string} text @param {(page: string) => void} open @returns {(Node | string)[]} */
function inline(text, open) {
  /** @type {(Node | string)[]} */
  const parts = [];
  let rest = text.replace(/\s*\n\s*/g, " ");
  for (let found = INLINE.exec(rest); found; found = INLINE.exec(rest)) {
    parts.push(rest.slice(0, found.index));
    rest = rest.slice(found.index + found[0].length);
    const [, code, strong, emphasis, words, target] = found;
    if (code) parts.push(make("code", {}, code));
    else if (strong) parts.push(make("strong", {}, ...inline(strong, open)));
    else if (emphasis) parts.push(make("em", {}, ...inline(emphasis, open)));
    else parts.push(link(words, target, open));
  }
  return [...parts, rest];
}

/** @param {string} words @param {string} target @param {(page: string) => void} open */
function link(words, target, open) {
  const page = SIBLING.exec(target)?.[1];
  if (!page) return make("span", {}, ...inline(words, open));
  const button = make("button", { type: "button", class: "link" }, ...inline(words, open));
  button.addEventListener("click", () => open(page));
  return button;
}

/** @param {string[]} lines of one table @param {(page: string) => void} open */
function table(lines, open) {
  const rows = lines.filter((line) => !/^\|[\s:|-]+\|$/.test(line)).map((line) => line.replace(/^\||\|\s*$/g, "").split("|"));
  return make("table", {}, ...rows.map((cells, i) => make("tr", {}, ...cells.map((cell) => make(i ? "td" : "th", {}, ...inline(cell.trim(), open))))));
}

/** @param {string[]} lines of one list @param {(page: string) => void} open */
function list(lines, open) {
  /** @type {string[]} */
  const items = [];
  for (const line of lines) {
    if (ITEM.test(line)) items.push(line.replace(ITEM, ""));
    else items[items.length - 1] += `\n${line.trim()}`;
  }
  return make(/^\d/.test(lines[0]) ? "ol" : "ul", {}, ...items.map((item) => make("li", {}, ...inline(item, open))));
}

/**
 * The elements of a page; its comments are left out.
 * @param {string} text @param {(page: string) => void} open what a link to a fault page does
 * @returns {HTMLElement[]}
 */
export function markdown(text, open) {
  const made = [];
  for (const block of text.replace(/<!--.*?-->/gs, "").split(/(```[\s\S]*?```)|\n\s*\n/)) {
    if (!block?.trim()) continue;
    const lines = block.replace(/^\n+|\s+$/g, "").split("\n");
    const heading = /^(#{1,4})\s+(.*)$/.exec(lines[0]);
    if (lines[0].startsWith("```")) made.push(make("pre", {}, lines.slice(1, -1).join("\n")));
    else if (heading) made.push(make(`h${heading[1].length + 1}`, {}, ...inline(heading[2], open)));
    else if (lines[0].startsWith("|")) made.push(table(lines, open));
    else if (ITEM.test(lines[0])) made.push(list(lines, open));
    else made.push(make("p", {}, ...inline(lines.join("\n"), open)));
  }
  return made;
}
