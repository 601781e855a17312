// One lane of the trace: a uPlot of one quantity's channels, its name, and why it is empty.
// @ts-check

import { make, number } from "./dom.js";
import { Ranged, yRange } from "./yrange.js";

/** @typedef {import("./store.js").Channel} Channel */
/** @typedef {import("./store.js").Store} Store */

/** @type {Record<Channel, {label: string, colour: string, dash?: number[], held?: boolean}>} held: constant from tick to tick */
export const LOOK = {
  position: { label: "position", colour: "--c1" },
  coarse: { label: "as the spring sees", colour: "--c2", held: true },
  velocity: { label: "velocity", colour: "--c3" },
  current: { label: "commanded", colour: "--c1", held: true },
  measured: { label: "measured", colour: "--c2" },
  force: { label: "force", colour: "--c4", held: true },
  late: { label: "lateness", colour: "--c5" },
  model: { label: "simulated", colour: "--c6", dash: [6, 4] },
  residual: { label: "measured − simulated", colour: "--c4" },
  derived1: { label: "derived 1", colour: "--c3" },
  derived2: { label: "derived 2", colour: "--c5" },
};

/**
 * @typedef {{id: string, title: string, channels: Channel[], shown: boolean, unit: () => string, fixed?: [number, number] | null}} LaneSpec
 *   fixed: least and largest value shown, in the channels' own unit; null: as the values are
 */

const MIN_SPAN = { position: 2, residual: 2, velocity: 0.1, current: 0.02, force: 1e-4, late: 20 };
const SHRINK = 0.98;
export const AXIS_PX = 62;

/** @type {Map<string, string>} */
export const colours = new Map();

/** A colour of the theme; asking the style sheet takes long, so it is asked once. @param {string} name */
export function colour(name) {
  let found = colours.get(name);
  if (found === undefined) {
    found = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    colours.set(name, found);
  }
  return found;
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

const steps = uPlot.paths.stepped?.({ align: 1 });
const lines = uPlot.paths.linear?.();

export class Lane extends Ranged {
  /** @param {HTMLElement} place @param {LaneSpec} spec @param {import("./trace.js").Trace} trace @param {boolean} last whether it carries the times of all */
  constructor(place, spec, trace, last) {
    super(spec, make("div", { class: "lane-head" }));
    this.spec = spec;
    this.trace = trace;
    this.raw = false;
    this.box = make("section", { class: "lane", "aria-label": spec.title });
    this.empty = make("p", { class: "empty", hidden: "" });
    this.box.append(this.head, this.empty);
    place.append(this.box);
    this.name();
    this.plot = this.build(last);
  }

  name() {
    this.head.replaceChildren(make("strong", {}, `${this.spec.title} `), make("span", { class: "unit" }, this.spec.unit()));
    for (const channel of this.spec.channels) {
      const { label, colour: variable, dash } = LOOK[channel];
      const key = make("span", { class: `key${dash ? " dashed" : ""}` });
      key.style.setProperty("--key", `var(${variable})`);
      const value = make("output", { class: "value", id: `value-${channel}` }, "–");
      this.head.append(make("span", { class: "legend" }, key, this.spec.channels.length > 1 ? `${label} ` : "", value));
    }
    this.head.append(make("output", { class: "lane-note bad", id: `note-${this.spec.id}` }));
    this.head.append(yRange(this));
    this.tellRange();
  }

  /** @param {boolean} last */
  build(last) {
    const axis = { stroke: () => colour("--ink-2"), grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { show: false } };
    /** @type {uPlot.Options} */
    const options = {
      width: 400,
      height: 120,
      legend: { show: false },
      pxAlign: 0,
      padding: [6, 12, 0, 0],
      cursor: { sync: { key: "time" }, drag: { x: false, y: false, setScale: false }, points: { show: false }, y: false },
      scales: { x: { time: false, auto: false, range: () => this.trace.view }, y: { range: () => this.range } },
      axes: [
        { ...axis, size: last ? 22 : 6, gap: 2, font: "11px system-ui", space: 70, values: (_, ticks) => (last ? ticks.map((tick, i) => (i < ticks.length - 1 ? number(tick, 6) : `${number(tick, 6)} s`)) : ticks.map(() => "")) },
        { ...axis, size: AXIS_PX, gap: 4, font: "11px system-ui", space: 20, values: (_, ticks) => ticks.map((tick) => number(tick, 4)) },
      ],
      series: [
        {},
        ...this.spec.channels.map((channel) => ({
          label: LOOK[channel].label,
          stroke: () => colour(LOOK[channel].colour),
          width: 1.25,
          dash: LOOK[channel].dash,
          points: { show: false },
          // a held value is drawn as the steps it is, as soon as single ticks are drawn at all
          paths: (/** @type {uPlot} */ plot, /** @type {number} */ index, /** @type {number} */ from, /** @type {number} */ to) =>
            (this.raw && LOOK[channel].held ? steps : lines)?.(plot, index, from, to) ?? null,
          spanGaps: false,
        })),
      ],
      hooks: { draw: [(plot) => this.trace.mark(plot, this)] },
    };
    const plot = new uPlot(options, /** @type {uPlot.AlignedData} */ ([[], ...this.spec.channels.map(() => [])]), this.box);
    this.trace.listen(plot, this);
    return plot;
  }

  /**
   * @param {Store} store @param {{starts: number[], ends: number[]}} buckets @param {Float64Array} x
   * @param {boolean} raw whether every bucket is one row @param {number} rows in view
   */
  draw(store, buckets, x, raw, rows) {
    /** @type {[number, number]} */
    const out = [0, 0];
    this.raw = raw;
    let low = Infinity;
    let high = -Infinity;
    const count = buckets.starts.length;
    const factor = this.trace.factor(this.spec);
    if (factor !== this.factor) {
      [this.low, this.high, this.factor] = [NaN, NaN, factor];
      this.tellRange();
    }
    const data = this.spec.channels.map((channel) => {
      /** @type {(number | null)[]} */
      const y = new Array(raw ? count : 2 * count);
      for (let i = 0; i < count; i++) {
        const start = buckets.starts[i];
        if (raw) {
          const value = start < 0 ? NaN : store.value(channel, start) * factor;
          y[i] = Number.isFinite(value) ? value : null;
          if (value < low) low = value;
          if (value > high) high = value;
          continue;
        }
        out[0] = Infinity;
        if (start >= 0) store.extent(channel, start, buckets.ends[i], out);
        const none = !Number.isFinite(out[0]) || !Number.isFinite(out[1]);
        y[2 * i] = none ? null : out[0] * factor;
        y[2 * i + 1] = none ? null : out[1] * factor;
        if (!none && out[0] * factor < low) low = out[0] * factor;
        if (!none && out[1] * factor > high) high = out[1] * factor;
      }
      return y;
    });
    this.explain(low <= high ? "" : this.trace.why(this.spec, rows));
    this.fit(low, high);
    this.plot.setData(/** @type {uPlot.AlignedData} */ (/** @type {unknown} */ ([x, ...data])), true);
  }

  /** An empty axis says why it is empty. @param {string} why */
  explain(why) {
    if (this.empty.textContent === why) return;
    this.empty.textContent = why;
    this.empty.hidden = !why;
  }

  /** Grow at once, shrink slowly: the scale does not flicker. @param {number} low @param {number} high */
  fit(low, high) {
    if (this.spec.fixed || !(low <= high)) return;
    const least = (/** @type {Record<string, number>} */ (MIN_SPAN)[this.spec.id] ?? 1e-6) * this.factor;
    const middle = (low + high) / 2;
    const half = Math.max((high - low) / 2, least / 2);
    const margin = 0.08 * 2 * half;
    const [bottom, top] = [middle - half - margin, middle + half + margin];
    this.low = bottom < this.low || Number.isNaN(this.low) ? bottom : this.low + (bottom - this.low) * (1 - SHRINK);
    this.high = top > this.high || Number.isNaN(this.high) ? top : this.high + (top - this.high) * (1 - SHRINK);
    /** @type {[number, number]} */ this.auto = [this.low, this.high];
  }
}
