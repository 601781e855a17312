// One quantity over another: force over position with the ideal spring drawn in, and the phase plane. Of the rows in view, with
// the releases before faded beneath, in the unit that is chosen.
// @ts-check

import { byId, make, number, say } from "./dom.js";
import { FLAG } from "./frames.js";
import { colour } from "./lane.js";
import { placeUnits, ticksOf } from "./source.js";
import { Ranged, listen, yRange } from "./yrange.js";

const MOST_POINTS = 4000;
const KEPT = 3;
const EVERY_MS = 100;
const LEFT = 62;
const BOTTOM = 30;
const TOP = 8;
const RIGHT = 12;

/** @typedef {"force" | "phase"} Kind */
/** @typedef {{x: Float64Array, y: Float64Array}} Curve */

/**
 * Rows as a curve, at most every so many of them; not a number where it is broken off: the force is one where the spring is
 * rendered alone, and the velocity is none across a moved origin.
 * @param {import("./source.js").Source} source @param {number} begin @param {number} end @param {Kind} kind @param {number} scale of a unit of place
 * @returns {Curve}
 */
export function curve(source, begin, end, kind, scale) {
  const { store } = source;
  const step = Math.max(1, Math.ceil((end - begin) / MOST_POINTS));
  const [x, y] = [[], []].map(() => /** @type {number[]} */ ([]));
  for (let row = begin; row < end; row += step) {
    const rendered = store.flags[row & store.mask] & FLAG.running;
    const value = kind === "phase" ? store.value("velocity", row) : rendered ? store.value("force", row) : NaN;
    x.push(!Number.isFinite(value) ? NaN :(store.counts[row & store.mask] * store.rawResolution) / scale);
    y.push(kind === "force" ? value : value / scale);
  }
  return { x: Float64Array.from(x), y: Float64Array.from(y) };
}

/** A curve of rad or m in a unit of place. @param {Curve} curve @param {number} scale @param {Kind} kind @returns {Curve} */
function scaled({ x, y }, scale, kind) {
  return { x: x.map((value) => value / scale), y: kind === "force" ? y : y.map((value) => value / scale) };
}

/**
 * The force of the ideal spring, F = −K x, on its side of the origin.
 * @param {any} config @param {number} low @param {number} high places @param {number} scale of a unit of place
 * @returns {Curve}
 */
export function idealSpring(config, low, high, scale) {
  const { stiffness, side } = config.spring;
  const acts = (/** @type {number} */ x) => side === "both" || (side === "positive" ? x > 0 : x < 0);
  const x = [low, ...(low < 0 && high > 0 ? [0] : []), high];
  return { x: Float64Array.from(x), y: Float64Array.from(x, (place) => (acts(place) ? -stiffness * place * scale : 0)) };
}

export class XY extends Ranged {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    const specs = { force: { id: "xy", title: "X–Y", fixed: null }, phase: { id: "xy", title: "X–Y", fixed: null } };
    super(specs.force, byId("xy-head"));
    this.view = view;
    this.head.append(yRange(this));
    this.canvas = /** @type {HTMLCanvasElement} */ (byId("xy-canvas"));
    this.kind = byId("xy-kind", HTMLSelectElement);
    this.unit = byId("xy-unit", HTMLSelectElement);
    /** The releases before, in rad or m. @type {Record<Kind, Curve>[]} */ this.before = [];
    this.drawnAt = 0;
    this.painted = null;
    this.kind.addEventListener("change", () => {
      this.spec = specs[/** @type {Kind} */ (this.kind.value)];
      this.tellRange();
      this.drawnAt = 0;
    });
    listen(this.canvas, this, ({ clientY }) => {
      const { top, height } = this.canvas.getBoundingClientRect();
      const [low, high] = this.range;
      return high - ((clientY - top - TOP) / (height - TOP - BOTTOM)) * (high - low);
    });
    this.unit.addEventListener("change", () => (this.drawnAt = 0));
  }

  /** A release is over: it stays beneath those that follow. @param {number} begin @param {number} end its rows */
  remember(begin, end) {
    const { live } = this.view;
    this.before.push({ force: curve(live, begin, end, "force", 1), phase: curve(live, begin, end, "phase", 1) });
    if (this.before.length > KEPT + 1) this.before.shift();
  }

  /** Once a frame; drawn ten times a second, where it is shown. */
  frame() {
    if (byId("xy").hidden || performance.now() - this.drawnAt < EVERY_MS) return;
    this.drawnAt = performance.now();
    this.draw();
  }

  draw() {
    const { source } = this.view;
    const units = placeUnits(source);
    if ([...this.unit.options].map((option) => option.value).join() !== Object.keys(units).join()) {
      this.unit.replaceChildren(...Object.keys(units).map((unit) => make("option", { value: unit }, unit)));
    }
    const kind = /** @type {Kind} */ (this.kind.value);
    const scale = units[this.unit.value];
    const { begin, end } = this.view.rows();
    const now = curve(source, Math.max(begin, source.store.first), end, kind, scale);
    const old = this.view.isLive ? this.before.slice(0, -1).map((each) => scaled(each[kind], scale, kind)) : [];
    const factor = kind === "force" ? 1 : 1 / scale;
    if (factor !== this.factor) {
      this.factor = factor;
      this.tellRange();
    }
    const x = extent([now, ...old], "x");
    this.auto = extent([now, ...old], "y");
    const y = this.range;
    const ideal = kind === "force" && source.config ? [idealSpring(source.config, x[0], x[1], scale)] : [];
    const drawn = now.x.reduce((count, value) => count + (Number.isFinite(value) ? 1 : 0), 0);
    const unit = kind === "force" ? source.units.force : `${this.unit.value}/s`;
    this.canvas.dataset.points = String(drawn);
    byId("xy-ideal").hidden = !ideal.length;
    this.canvas.dataset.before = String(old.length);
    say("xy-words", drawn ? `in ${unit} over ${this.unit.value}` : kind === "force" ? "the spring is not rendered in this window" : "no rows in this window");
    /** What is painted, for a picture of it. @type {{now: Curve, old: Curve[], ideal: Curve[], x: [number, number], y: [number, number], title: string} | null} */
    this.painted = { now, old, ideal, x, y, title: `X–Y: ${kind === "force" ? "force" : "velocity"} (${unit}) over position (${this.unit.value})` };
    this.paint(now, old, ideal, x, y);
  }

  /** @param {Curve} now @param {Curve[]} old @param {Curve[]} ideal @param {[number, number]} x @param {[number, number]} y */
  paint(now, old, ideal, x, y) {
    const { canvas } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = devicePixelRatio;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const ctx = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    ctx.scale(ratio, ratio);
    ctx.font = "11px system-ui";
    const at = (/** @type {number} */ value) => LEFT + ((value - x[0]) / (x[1] - x[0])) * (width - LEFT - RIGHT);
    const up = (/** @type {number} */ value) => height - BOTTOM - ((value - y[0]) / (y[1] - y[0])) * (height - TOP - BOTTOM);
    ctx.strokeStyle = colour("--grid");
    ctx.fillStyle = colour("--ink-2");
    const line = (/** @type {number[]} */ [x0, y0, x1, y1]) => {
      ctx.beginPath();
      ctx.moveTo(x0, y0);
      ctx.lineTo(x1, y1);
      ctx.stroke();
    };
    ctx.textAlign = "center";
    for (const value of ticksOf(x[0], x[1], width / 90)) {
      line([at(value), TOP, at(value), height - BOTTOM]);
      ctx.fillText(number(value, 4), at(value), height - BOTTOM + 13);
    }
    ctx.fillText(`position (${this.unit.value})`, (LEFT + width) / 2, height - 4);
    ctx.textAlign = "right";
    for (const value of ticksOf(y[0], y[1], height / 34)) {
      line([LEFT, up(value), width - RIGHT, up(value)]);
      ctx.fillText(number(value, 4), LEFT - 4, up(value) + 4);
    }
    const draw = (/** @type {Curve} */ each, /** @type {string} */ stroke, /** @type {number} */ alpha, /** @type {number[]} */ dash) => {
      ctx.strokeStyle = stroke;
      ctx.globalAlpha = alpha;
      ctx.setLineDash(dash);
      ctx.lineWidth = 1.25;
      ctx.beginPath();
      let down = false;
      for (let i = 0; i < each.x.length; i++) {
        const there = Number.isFinite(each.x[i]);
        if (there && down) ctx.lineTo(at(each.x[i]), up(each.y[i]));
        else if (there) ctx.moveTo(at(each.x[i]), up(each.y[i]));
        down = there;
      }
      ctx.stroke();
    };
    ctx.beginPath();
    ctx.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
    ctx.clip();
    for (const each of old) draw(each, colour("--c3"), 0.35, []);
    draw(now, colour("--c1"), 1, []);
    for (const each of ideal) draw(each, colour("--ink"), 0.9, [6, 4]);
    ctx.globalAlpha = 1;
  }
}

/** From the least to the largest, with a margin; never nothing. @param {Curve[]} curves @param {"x" | "y"} axis @returns {[number, number]} */
function extent(curves, axis) {
  let [low, high] = [Infinity, -Infinity];
  for (const each of curves) {
    for (const value of each[axis]) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [-1, 1];
  const margin = 0.06 * (high - low) || Math.abs(low) || 1;
  return [low - margin, high + margin];
}
