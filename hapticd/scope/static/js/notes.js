// Notes and markers: said here or by anybody else, kept in the run file by the daemon, and drawn where they were said.
// @ts-check

import { byId, make, number, say } from "./dom.js";
import { ask } from "./link.js";
import { Field } from "./quantity.js";

const MOST = 512;

/**
 * @typedef {{event: "note" | "marker", tick: number, text?: string, name?: string, value?: unknown}} Noted as in a run file
 * @typedef {{time: number, words: string, noted: Noted}} Mark
 */

/** In one line. @param {Noted} noted */
export function wordsOf({ event, text, name, value }) {
  if (event === "note") return String(text);
  return value === null || value === undefined ? String(name) : `${name} ${value}`;
}

/**
 * The marks of a file's events, at the times of their rows.
 * @param {any[]} events @param {import("./store.js").Store} store
 * @returns {Mark[]}
 */
export function marksOf(events, store) {
  return events
    .filter(({ event, row }) => (event === "note" || event === "marker") && row >= 0 && store.head > 0)
    .map((noted) => ({ time: store.timeAt(Math.min(noted.row, store.head - 1)), words: wordsOf(noted), noted }));
}

/** Those of the rows from `begin` to `end`, as events of a run file that begins there. @param {Mark[]} marks @param {import("./store.js").Store} store @param {number} begin @param {number} end */
export function eventsOf(marks, store, begin, end) {
  return marks
    .map(({ time, noted }) => ({ ...noted, row: store.rowAt(time) - begin }))
    .filter(({ row }) => row >= 0 && row < end - begin);
}

export class Notes {
  /** @param {import("./source.js").Source} live */
  constructor(live) {
    this.live = live;
    /** @type {Set<string>} */ this.known = new Set();
    this.shown = "";
    byId("note-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const input = byId("note-text", HTMLInputElement);
      if (input.value.trim()) this.send("note", { text: input.value.trim() }).then((sent) => sent && (input.value = ""));
    });
    byId("marker-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.mark();
    });
    /** @type {Record<"subject" | "condition", Field>} */
    this.fields = { subject: this.field("subject"), condition: this.field("condition") };
  }

  /** A label of the next recordings; nothing in it: none. @param {"subject" | "condition"} name */
  field(name) {
    const send = (/** @type {import("./quantity.js").Quantity} */ { text }) =>
      // quoted, or a number would be read as one
      ask("set", { settings: { [`record.${name}`]: text.trim() ? JSON.stringify(text.trim()) : null }, force: false });
    return new Field(byId(`record-${name}`, HTMLInputElement), () => "", send, byId(`record-${name}-refusal`));
  }

  /** @param {any} config in force */
  configured(config) {
    for (const name of /** @type {const} */ (["subject", "condition"])) this.fields[name].settle(config.record[name] ?? "");
  }

  /** A marker, now. */
  mark() {
    const name = byId("marker-name", HTMLInputElement).value.trim() || "mark";
    return this.send("marker", { name, value: byId("marker-value", HTMLInputElement).value.trim() });
  }

  /** @param {"note" | "marker"} name @param {any} body */
  async send(name, body) {
    try {
      const { tick } = await ask(name, body);
      say("note-answer", `at tick ${tick}`);
      return true;
    } catch (error) {
      say("note-answer", error instanceof Error ? error.message : String(error));
      return false;
    }
  }

  /** What the daemon says of the recording; a mark waits for its row. @param {{notes: Noted[]}} recorder */
  take({ notes }) {
    const { store, marks } = this.live;
    for (const noted of notes) {
      const key = JSON.stringify(noted);
      const row = store.rowOfTick(noted.tick);
      if (row < 0 || this.known.has(key)) continue;
      this.known.add(key);
      marks.push({ time: store.timeAt(row), words: wordsOf(noted), noted });
      if (marks.length > MOST) marks.shift();
    }
    const shown = JSON.stringify(notes);
    if (shown === this.shown) return;
    this.shown = shown;
    byId("notes").replaceChildren(
      ...[...notes].reverse().map((noted) => make("li", {}, make("span", { class: "unit" }, `tick ${number(noted.tick, 12)}`), make("span", {}, wordsOf(noted)))),
    );
  }
}
