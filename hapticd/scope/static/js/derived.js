// Derived channels: what is typed is worked out for every row that is here and that comes, and drawn in a lane of its own.
// @ts-check

import { byId, lookUp, make } from "./dom.js";
import { compile } from "./expression.js";
import { LOOK } from "./lane.js";
import { CHANNELS, DERIVED } from "./store.js";

/** @typedef {import("./source.js").Source} Source */
/** @typedef {import("./store.js").Channel} Channel */

const PLACES = new Set(["coarse", "model", "residual"]);
const NAMES = [...CHANNELS.filter((name) => !DERIVED.includes(name)), "time"];

/**
 * An expression as the value of a row, in SI: rad or m, A, N m or N, s.
 * @param {string} text @param {Source} source
 * @returns {(row: number) => number}
 */
function ruleOf(text, source) {
  const { store } = source;
  let at = 0;
  const value = compile(text, (name) => {
    if (name === "time") return () => store.timeAt(at);
    if (name === "position") return () => store.counts[at & store.mask] * store.rawResolution;
    if (NAMES.includes(name)) {
      const { values } = store.channels[/** @type {Channel} */ (name)];
      if (PLACES.has(name)) return () => values[at & store.mask] * store.rawResolution * store.decimation;
      const factor = name === "late" ? 1e-6 : 1;
      return () => values[at & store.mask] * factor;
    }
    if (typeof lookUp(source.config, name) !== "number") throw new Error(`${name} is no channel and no setting; channels are ${NAMES.join(", ")}`);
    /** @type {any} */ let config = null;
    let number = NaN;
    return () => {
      if (config !== source.config) [config, number] = [source.config, Number(lookUp(source.config, name))];
      return number;
    };
  });
  return (row) => {
    at = row;
    return value();
  };
}

export class Derived {
  /** @param {import("./view.js").View} view @param {() => void} changed called with other lanes */
  constructor(view, changed) {
    this.view = view;
    this.changed = changed;
    /** @type {Map<Channel, string>} */ this.texts = new Map();
    for (const name of DERIVED) {
      byId(name).addEventListener("keydown", (event) => event.key === "Enter" && this.read(name));
      byId(name).addEventListener("change", () => this.read(name));
    }
  }

  /** @param {Channel} name */
  read(name) {
    const input = byId(name, HTMLInputElement);
    const text = input.value.trim();
    let why = "";
    try {
      for (const source of new Set([this.view.live, this.view.source])) source.store.define(name, text ? ruleOf(text, source) : null);
      if (text) this.texts.set(name, text);
      else this.texts.delete(name);
      this.lane(name, text);
    } catch (error) {
      why = error instanceof Error ? error.message : String(error);
    }
    byId(`${name}-refusal`).textContent = why;
    input.setAttribute("aria-invalid", String(Boolean(why)));
  }

  /** @param {Channel} name @param {string} text */
  lane(name, text) {
    const { trace } = this.view;
    const title = LOOK[name].label;
    trace.specs = trace.specs.filter((spec) => spec.id !== name);
    if (text) trace.specs.push({ id: name, title, channels: [name], shown: true, unit: () => `${text}, SI` });
    trace.rebuild();
    for (const id of ["measure-channel", "trigger-channel"]) {
      const options = [...byId(id, HTMLSelectElement).options];
      const there = options.find(({ value }) => value === name);
      if (text && !there) byId(id).append(make("option", { value: name }, title));
      else if (!text) there?.remove();
    }
    this.changed();
  }

  /** Another source is looked at: its rows have these channels, too, where it has what they take. */
  look() {
    const { source } = this.view;
    for (const [name, text] of this.texts) {
      try {
        source.store.define(name, ruleOf(text, source));
      } catch {
        source.store.define(name, null);
      }
    }
  }
}
