// The Z-width: what of stiffness K and virtual damping B the device can render, in the worst of hands; drag to set both.
// @ts-check

import { byId, lookUp, number, say, svg } from "./dom.js";
import { ask } from "./link.js";

/** @typedef {{stiffness: number[], damping: number[], outcome: number[][], verdicts: string[], exact: number[], linear: number[]}} Found */
/** @typedef {{K: number, B: number}} Point */

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [380, 224, 52, 8, 8, 32];
/** Axes are of cube roots: most springs are in the soft corner. */
const ROOT = 1 / 3;
const DIGITS = 3;
const DECADES = 4;
/** Room of a number on the axis. */
const LABEL = 34;

export class ZMap {
  /**
   * @param {import("./view.js").View} view
   * @param {{preview: (point: Point) => void, send: (point: Point) => void, withdraw: () => void}} does with a point that is dragged, and let go
   */
  constructor(view, does) {
    this.view = view;
    this.does = does;
    this.place = byId("zmap");
    /** @type {Found | null} */ this.found = null;
    /** @type {Point | null} */ this.ghost = null;
    this.asking = false;
    this.of = "";
    byId("to-zmap").addEventListener("click", () => this.open(this.place.hidden));
    this.place.addEventListener("pointerdown", (event) => {
      if (!this.found || document.body.dataset.control !== "mine" || !this.view.isLive) return;
      this.place.setPointerCapture(event.pointerId);
      this.drag(event);
    });
    this.place.addEventListener("pointermove", (event) => this.ghost && this.drag(event));
    this.place.addEventListener("pointerup", () => {
      const { ghost } = this;
      this.ghost = null;
      if (ghost) this.does.send(ghost);
      this.show();
    });
    this.place.addEventListener("pointercancel", () => this.withdraw());
  }

  /** @param {boolean} open */
  open(open) {
    this.place.hidden = !open;
    byId("plane").hidden = open;
    byId("to-zmap").setAttribute("aria-pressed", String(open));
    byId("zmap-key").hidden = !open;
    if (!open) say("zmap-words", "");
    this.show();
  }

  /** Take back what is dragged. */
  withdraw() {
    if (this.ghost) this.does.withdraw();
    this.ghost = null;
    this.show();
  }

  /** The device, of whatever spring. */
  get device() {
    const { config } = this.view.live;
    return config ? JSON.stringify({ ...config, spring: { ...config.spring, stiffness: 0, damping: 0, origin: 0 } }) : "";
  }

  /** Draw it, and ask for it where it is of another device. */
  show() {
    if (this.place.hidden) return;
    this.draw();
    if (!this.asking && this.device && this.device !== this.of) this.ask();
  }

  async ask() {
    this.asking = true;
    this.of = this.device;
    this.found = null;
    this.draw();
    try {
      this.found = await ask("zwidth", {});
    } catch (error) {
      say("zmap-words", error instanceof Error ? error.message : String(error));
    }
    this.asking = false;
    this.show();
  }

  /** @param {number} value @param {number} most 0 to 1 along an axis */
  along(value, most) {
    return Math.min(1, Math.max(0, value / most)) ** ROOT;
  }

  /** @param {number} B */
  x(B) {
    return LEFT + this.along(B, this.most.B) * (WIDTH - LEFT - RIGHT);
  }

  /** @param {number} K */
  y(K) {
    return HEIGHT - BOTTOM - this.along(K, this.most.K) * (HEIGHT - TOP - BOTTOM);
  }

  get most() {
    const last = (/** @type {number[]} */ values) => values[values.length - 1];
    return this.found ? { K: last(this.found.stiffness), B: last(this.found.damping) } : { K: 1, B: 1 };
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const box = this.place.getBoundingClientRect();
    const part = (/** @type {number} */ at, /** @type {number} */ low, /** @type {number} */ high) => Math.min(1, Math.max(0, (at - low) / (high - low))) ** (1 / ROOT);
    const [x, y] = [((event.clientX - box.left) * WIDTH) / box.width, ((event.clientY - box.top) * HEIGHT) / box.height];
    const round = (/** @type {number} */ value) => Number(value.toPrecision(DIGITS));
    this.ghost = { B: round(this.most.B * part(x, LEFT, WIDTH - RIGHT)), K: round(this.most.K * part(y, HEIGHT - BOTTOM, TOP)) };
    this.does.preview(this.ghost);
    this.draw();
  }

  /** The largest K below which all is calm, which is finer than the points. @param {number} B */
  calmBelow(B) {
    const { damping, exact } = /** @type {Found} */ (this.found);
    const after = Math.max(1, damping.findIndex((each) => each >= B));
    const part = Math.min(1, (B - damping[after - 1]) / (damping[after] - damping[after - 1]));
    return exact[after - 1] + part * (exact[after] - exact[after - 1]);
  }

  /** What it is like at a point, in words. @param {Point} point */
  verdict({ K, B }) {
    const { found } = this;
    if (!found) return "";
    if (K <= this.calmBelow(B)) return "calm";
    const nearest = (/** @type {number[]} */ values, /** @type {number} */ value) => values.reduce((best, each, i) => (Math.abs(each - value) < Math.abs(values[best] - value) ? i : best), 0);
    return found.verdicts[found.outcome[nearest(found.damping, B)][nearest(found.stiffness, K)]];
  }

  draw() {
    const { found, ghost } = this;
    const { config, units } = this.view.live;
    const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-labelledby": "zmap-title" });
    const [unitK, unitB] = units.position === "m" ? ["N/m", "N s/m"] : ["N m/rad", "N m s/rad"];
    const now = { K: Number(lookUp(config, "spring.stiffness")), B: Number(lookUp(config, "spring.damping")) };
    const words = found ? `K = ${number((ghost ?? now).K)} ${unitK}, B = ${number((ghost ?? now).B)} ${unitB}: ${this.verdict(ghost ?? now)} in the worst of hands` : "the Z-width is being worked out, some seconds …";
    root.append(svg("title", { id: "zmap-title" }, `Z-width: ${words}`));
    if (found) this.fields(root, found);
    this.axes(root, unitK, unitB);
    if (found) {
      if (ghost) root.append(svg("circle", { class: "ghost", id: "zmap-ghost", cx: this.x(ghost.B), cy: this.y(ghost.K), r: 6 }));
      root.append(svg("circle", { class: "point", id: "zmap-point", cx: this.x(now.B), cy: this.y(now.K), r: 5 }));
    }
    this.place.replaceChildren(root);
    if (found || this.asking) say("zmap-words", words);
  }

  /** @param {SVGElement} root @param {Found} found */
  fields(root, found) {
    const edges = (/** @type {number[]} */ values) => values.map((value, i) => (value + (values[i + 1] ?? value)) / 2);
    const [right, top] = [edges(found.damping), edges(found.stiffness)];
    found.outcome.forEach((column, i) =>
      column.forEach((verdict, j) => {
        const [x0, x1] = [this.x(i ? right[i - 1] : 0), this.x(right[i])];
        const [y0, y1] = [this.y(j ? top[j - 1] : 0), this.y(top[j])];
        root.append(svg("rect", { class: `z z${verdict}`, x: x0, y: y1, width: x1 - x0 + 0.3, height: y0 - y1 + 0.3 }));
      }),
    );
    const floor = `${this.x(this.most.B)},${HEIGHT - BOTTOM} ${LEFT},${HEIGHT - BOTTOM}`;
    const corner = (/** @type {number} */ K, /** @type {number} */ i) => `${this.x(found.damping[i]).toFixed(1)},${this.y(K).toFixed(1)}`;
    root.append(svg("polygon", { class: "z zcalm", points: `${found.exact.map(corner).join(" ")} ${floor}` }));
    for (const [kind, line] of Object.entries({ exact: found.exact, linear: found.linear })) {
      root.append(svg("polyline", { class: `boundary ${kind}`, points: line.map(corner).join(" ") }));
    }
  }

  /** @param {SVGElement} root @param {string} unitK @param {string} unitB */
  axes(root, unitK, unitB) {
    const decades = (/** @type {number} */ most) => Array.from({ length: DECADES }, (_, i) => 10 ** (Math.floor(Math.log10(most)) - i));
    if (this.found) {
      for (const K of decades(this.most.K)) root.append(svg("text", { class: "tick", x: LEFT - 4, y: this.y(K) + 4, "text-anchor": "end" }, number(K)));
      // the largest first; those near zero would lie over each other
      let left = Infinity;
      for (const B of decades(this.most.B)) {
        const x = this.x(B);
        if (left - x < LABEL) break;
        left = x;
        root.append(svg("text", { class: "tick", x, y: HEIGHT - BOTTOM + 13, "text-anchor": "middle" }, number(B)));
      }
    }
    root.append(svg("text", { class: "axis", x: (LEFT + WIDTH) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, `B  virtual damping, ${unitB}`));
    root.append(svg("text", { class: "axis", "text-anchor": "middle", transform: `translate(11 ${(HEIGHT - BOTTOM) / 2}) rotate(-90)` }, `K  stiffness, ${unitK}`));
  }
}
