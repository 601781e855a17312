// The trace: one lane of uPlot for each quantity, all over the same time, drawn from the store's pyramid.
// @ts-check

import { byId, make, number } from "./dom.js";

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
};

/** @typedef {{id: string, title: string, channels: Channel[], shown: boolean, unit: () => string}} LaneSpec */

const MIN_SPAN = { position: 2, residual: 2, velocity: 0.1, current: 0.02, force: 1e-4, late: 20 };
const SHRINK = 0.98;
const AXIS_PX = 62;

/** @type {Map<string, string>} */
const colours = new Map();

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

class Lane {
  /** @param {HTMLElement} place @param {LaneSpec} spec @param {Trace} trace @param {boolean} last whether it carries the times of all */
  constructor(place, spec, trace, last) {
    this.spec = spec;
    this.trace = trace;
    this.raw = false;
    this.low = NaN;
    this.high = NaN;
    /** @type {[number, number]} */
    this.range = [-1, 1];
    this.box = make("section", { class: "lane", "aria-label": spec.title });
    this.head = make("div", { class: "lane-head" });
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
    const data = this.spec.channels.map((channel) => {
      const { values } = store.channels[channel];
      /** @type {(number | null)[]} */
      const y = new Array(raw ? count : 2 * count);
      for (let i = 0; i < count; i++) {
        const start = buckets.starts[i];
        if (raw) {
          const value = start < 0 ? NaN : values[start & store.mask];
          y[i] = Number.isFinite(value) ? value : null;
          if (value < low) low = value;
          if (value > high) high = value;
          continue;
        }
        out[0] = Infinity;
        if (start >= 0) store.extent(channel, start, buckets.ends[i], out);
        const none = !Number.isFinite(out[0]) || !Number.isFinite(out[1]);
        y[2 * i] = none ? null : out[0];
        y[2 * i + 1] = none ? null : out[1];
        if (!none && out[0] < low) low = out[0];
        if (!none && out[1] > high) high = out[1];
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
    if (!(low <= high)) return;
    const least = /** @type {Record<string, number>} */ (MIN_SPAN)[this.spec.id] ?? 1e-6;
    const middle = (low + high) / 2;
    const half = Math.max((high - low) / 2, least / 2);
    const margin = 0.08 * 2 * half;
    const [bottom, top] = [middle - half - margin, middle + half + margin];
    this.low = bottom < this.low || Number.isNaN(this.low) ? bottom : this.low + (bottom - this.low) * (1 - SHRINK);
    this.high = top > this.high || Number.isNaN(this.high) ? top : this.high + (top - this.high) * (1 - SHRINK);
    this.range = [this.low, this.high];
  }
}

export class Trace {
  /**
   * @param {LaneSpec[]} specs
   * @param {(spec: LaneSpec, rows: number) => string} why a lane without values is empty
   * @param {(event: {kind: "zoom", factor: number, at: number} | {kind: "pan", by: number} | {kind: "cursor", which: "a" | "b" | "y1" | "y2", at: number, lane: string}) => void} act
   */
  constructor(specs, why, act) {
    this.why = why;
    this.act = act;
    this.place = byId("lanes");
    /** @type {[number, number]} */
    this.view = [-1, 0];
    this.zero = 0;
    /** @type {{a: number, b: number}} times, not a number where there is none */
    this.cursors = { a: NaN, b: NaN };
    /** @type {{lane: string, y1: number, y2: number}} */
    this.values = { lane: "position", y1: NaN, y2: NaN };
    /** @type {import("./store.js").Gap[]} */ this.gaps = [];
    /** @type {Store | null} */ this.store = null;
    this.triggerTime = NaN;
    /** @type {{lane: string, level: number} | null} */
    this.level = null;
    this.hover = NaN;
    this.hoverLane = "position";
    this.specs = specs;
    /** @type {Lane[]} */ this.lanes = [];
    this.rebuild();
    new ResizeObserver(() => this.layout()).observe(this.place);
  }

  rebuild() {
    for (const lane of this.lanes) lane.plot.destroy();
    this.place.replaceChildren();
    const shown = this.specs.filter((spec) => spec.shown);
    this.lanes = shown.map((spec, i) => new Lane(this.place, spec, this, i === shown.length - 1));
    this.layout();
  }

  layout() {
    const width = this.place.clientWidth;
    const axes = 16;
    const each = (this.place.clientHeight - axes) / Math.max(1, this.lanes.length);
    this.lanes.forEach((lane, i) => {
      const more = i === this.lanes.length - 1 ? axes : 0;
      const height = Math.max(48, Math.floor(each - lane.head.offsetHeight - 2) + more);
      if (width > 0) lane.plot.setSize({ width, height });
    });
  }

  /** Their units have changed. */
  rename() {
    for (const lane of this.lanes) lane.name();
  }

  /** Take the theme's colours. */
  redraw() {
    colours.clear();
    for (const lane of this.lanes) lane.plot.redraw(false, true);
  }

  /**
   * Draw the rows of a time span.
   * @param {Store} store @param {number} from @param {number} to @param {number} zero the time that is called 0
   */
  draw(store, from, to, zero) {
    this.store = store;
    this.view = [from - zero, to - zero];
    this.zero = zero;
    const begin = Math.max(store.first, store.rowAt(from) - 1);
    const end = Math.min(store.head, store.rowAt(to) + 1);
    const pixels = Math.max(200, this.place.clientWidth - AXIS_PX);
    const raw = end - begin <= 2 * pixels;
    const buckets = store.buckets(begin, end, raw ? Infinity : pixels, (to - from) / pixels);
    const count = buckets.starts.length;
    const x = new Float64Array(raw ? count : 2 * count);
    let last = from - zero;
    for (let i = 0; i < count; i++) {
      const start = buckets.starts[i];
      if (start >= 0) last = store.timeAt(start) - zero;
      if (raw) {
        x[i] = last;
      } else {
        x[2 * i] = last;
        if (start >= 0) last = (last + store.timeAt(buckets.ends[i] - 1) - zero) / 2;
        x[2 * i + 1] = last;
      }
    }
    this.gaps = store.gapsWithin(begin, end);
    for (const lane of this.lanes) lane.draw(store, buckets, x, raw, Math.max(0, end - begin));
    return { begin, end };
  }

  /** What lies over the curves: gaps, trigger, cursors. @param {uPlot} plot @param {Lane} lane */
  mark(plot, lane) {
    const { ctx, bbox } = plot;
    const vertical = (/** @type {number} */ at, /** @type {string} */ stroke, /** @type {number[]} */ dash, /** @type {string} */ label) => {
      if (!(at >= this.view[0] && at <= this.view[1])) return;
      const x = Math.round(plot.valToPos(at, "x", true)) + 0.5;
      ctx.strokeStyle = stroke;
      ctx.setLineDash(dash);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      if (label) {
        ctx.fillStyle = stroke;
        ctx.fillText(label, x + 3 * devicePixelRatio, bbox.top + 10 * devicePixelRatio);
      }
    };
    const horizontal = (/** @type {number} */ at, /** @type {string} */ stroke, /** @type {number[]} */ dash) => {
      const y = Math.round(plot.valToPos(at, "y", true)) + 0.5;
      if (!(y >= bbox.top && y <= bbox.top + bbox.height)) return;
      ctx.strokeStyle = stroke;
      ctx.setLineDash(dash);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    };
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.font = `${11 * devicePixelRatio}px system-ui`;
    ctx.textAlign = "left";
    const store = this.store;
    if (store) {
      // a gap wider than a pixel is a tinted band; every one is a mark at the top
      const bad = colour("--gap");
      ctx.fillStyle = bad;
      let marked = -Infinity;
      for (const gap of this.gaps) {
        const left = plot.valToPos(store.timeAt(gap.row - 1) - this.zero, "x", true);
        const right = plot.valToPos(store.timeAt(gap.row) - this.zero, "x", true);
        const [from, to] = [Math.max(left, bbox.left), Math.min(right, bbox.left + bbox.width)];
        if (to < from || to < marked + 1) continue; // the pixel has its mark
        marked = to;
        if (to - from > 1) {
          ctx.globalAlpha = 0.18;
          ctx.fillRect(from, bbox.top, to - from, bbox.height);
          ctx.globalAlpha = 1;
        }
        ctx.fillRect(from, bbox.top, Math.max(to - from, 2 * devicePixelRatio), 3 * devicePixelRatio);
      }
    }
    vertical(this.triggerTime - this.zero, colour("--trigger"), [2, 3], "T");
    if (this.level && this.level.lane === lane.spec.id) horizontal(this.level.level, colour("--trigger"), [2, 3]);
    vertical(this.cursors.a - this.zero, colour("--ink"), [], "A");
    vertical(this.cursors.b - this.zero, colour("--ink"), [], "B");
    if (this.values.lane === lane.spec.id) {
      horizontal(this.values.y1, colour("--ink"), [5, 3]);
      horizontal(this.values.y2, colour("--ink"), [5, 3]);
    }
    ctx.restore();
  }

  /** Mouse and touch on a lane. @param {uPlot} plot @param {Lane} lane */
  listen(plot, lane) {
    const { over } = plot;
    let from = NaN;
    let moved = false;
    const timeAt = (/** @type {number} */ x) => plot.posToVal(x, "x") + this.zero;
    over.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        if (event.shiftKey) this.act({ kind: "pan", by: (Math.sign(event.deltaY || event.deltaX) * (this.view[1] - this.view[0])) / 10 });
        else this.act({ kind: "zoom", factor: event.deltaY > 0 ? 1.25 : 0.8, at: timeAt(event.offsetX) });
      },
      { passive: false },
    );
    over.addEventListener("pointerdown", (event) => {
      from = event.offsetX;
      moved = false;
      over.setPointerCapture(event.pointerId);
    });
    over.addEventListener("pointermove", (event) => {
      this.hover = timeAt(event.offsetX);
      this.hoverLane = lane.spec.id;
      if (Number.isNaN(from) || (Math.abs(event.offsetX - from) < 4 && !moved)) return;
      moved = true;
      this.act({ kind: "pan", by: plot.posToVal(from, "x") - plot.posToVal(event.offsetX, "x") });
      from = event.offsetX;
    });
    over.addEventListener("pointerup", (event) => {
      from = NaN;
      if (moved) return;
      const { id } = lane.spec;
      if (event.altKey) this.act({ kind: "cursor", which: event.shiftKey ? "y2" : "y1", at: plot.posToVal(event.offsetY, "y"), lane: id });
      else this.act({ kind: "cursor", which: event.shiftKey ? "b" : "a", at: timeAt(event.offsetX), lane: id });
    });
    over.addEventListener("pointercancel", () => (from = NaN));
    over.addEventListener("pointerleave", () => (this.hover = NaN));
  }

  /** Everything that is seen, as one picture. */
  picture() {
    const sources = this.lanes.map((lane) => ({ canvas: lane.plot.ctx.canvas, title: `${lane.spec.title} (${lane.spec.unit()})` }));
    const canvas = document.createElement("canvas");
    const strip = 18 * devicePixelRatio;
    canvas.width = Math.max(...sources.map((source) => source.canvas.width));
    canvas.height = sources.reduce((sum, source) => sum + source.canvas.height + strip, 0);
    const ctx = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    ctx.fillStyle = colour("--panel");
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.fillStyle = colour("--ink");
    ctx.font = `${12 * devicePixelRatio}px system-ui`;
    let top = 0;
    for (const { canvas: source, title } of sources) {
      ctx.fillText(title, 4 * devicePixelRatio, top + 13 * devicePixelRatio);
      ctx.drawImage(source, 0, top + strip);
      top += source.height + strip;
    }
    return canvas;
  }
}
