// The trace: one lane for each quantity, all over the same time, drawn from the store's pyramid.
// @ts-check

import { byId } from "./dom.js";
import { listenToAxis } from "./yrange.js";
import { AXIS_PX, Lane, colour, colours } from "./lane.js";

/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("./lane.js").LaneSpec} LaneSpec */

const LONGEST_LABEL = 24;

/** @param {string} words */
const brief = (words) => (words.length > LONGEST_LABEL ? `${words.slice(0, LONGEST_LABEL - 1)}…` : words);

export class Trace {
  /**
   * @param {LaneSpec[]} specs
   * @param {(spec: LaneSpec) => number} factor how many of the shown unit one of a lane's own is
   * @param {(spec: LaneSpec, rows: number) => string} why a lane without values is empty
   * @param {(event: {kind: "zoom", factor: number, at: number} | {kind: "pan", by: number} | {kind: "cursor", which: "a" | "b" | "y1" | "y2", at: number, lane: string}) => void} act
   */
  constructor(specs, factor, why, act) {
    this.factor = factor;
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
    /** @type {import("./notes.js").Mark[]} */ this.marks = [];
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
    for (const { time, words } of this.marks) vertical(time - this.zero, colour("--ink-2"), [1, 3], lane === this.lanes[0] ? brief(words) : "");
    vertical(this.triggerTime - this.zero, colour("--trigger"), [2, 3], "T");
    if (this.level && this.level.lane === lane.spec.id) horizontal(this.level.level * lane.factor, colour("--trigger"), [2, 3]);
    vertical(this.cursors.a - this.zero, colour("--ink"), [], "A");
    vertical(this.cursors.b - this.zero, colour("--ink"), [], "B");
    if (this.values.lane === lane.spec.id) {
      horizontal(this.values.y1 * lane.factor, colour("--ink"), [5, 3]);
      horizontal(this.values.y2 * lane.factor, colour("--ink"), [5, 3]);
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
        if (event.altKey) lane.zoomY(event.deltaY > 0 ? 1.25 : 0.8, plot.posToVal(event.offsetY, "y"));
        else if (event.shiftKey) this.act({ kind: "pan", by: (Math.sign(event.deltaY || event.deltaX) * (this.view[1] - this.view[0])) / 10 });
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
      if (event.altKey) this.act({ kind: "cursor", which: event.shiftKey ? "y2" : "y1", at: plot.posToVal(event.offsetY, "y") / lane.factor, lane: id });
      else this.act({ kind: "cursor", which: event.shiftKey ? "b" : "a", at: timeAt(event.offsetX), lane: id });
    });
    listenToAxis(plot, lane);
    over.addEventListener("pointercancel", () => (from = NaN));
    over.addEventListener("pointerleave", () => (this.hover = NaN));
  }
}
