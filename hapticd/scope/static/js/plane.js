// The stability plane of Fig. 3 and 5, logarithmic: regions, boundaries, operating point, its trail, and the ghost of a
// setting that is being dragged. Every number stands beside it as text.
// @ts-check

import { byId, number, say, svg } from "./dom.js";

const WIDTH = 380;
const HEIGHT = 224;
const LEFT = 44;
const RIGHT = 8;
const TOP = 8;
const BOTTOM = 32;
const TRAIL = 40;
const DECADES = { beta: [-2, 1], sigma: [-2, 3] };

/** @typedef {{mu: number|null, beta: number|null, sigma: number|null, tau_d: number, region: string, words: string, deflection: number,
 *   region_here: string, words_here: string, velocity_limit: {ticks_per_period: number|null, si: number|null},
 *   deflection_limit: {ticks: number|null, si: number|null}, cycle: {ticks: number, hz: number} | null}} Point */
/** @typedef {{point: Point, beta_line: number, sigma_line: number, beta: number[], paper: (number|null)[]}} PlaneData */

export class Plane {
  constructor() {
    this.place = byId("plane");
    /** @type {PlaneData | null} */ this.data = null;
    /** @type {{beta: number, sigma: number}[]} */ this.trail = [];
    /** @type {PlaneData | null} */ this.ghost = null;
    this.trails = true;
    this.units = { position: "rad", velocity: "rad/s" };
  }

  /** An operating point. @param {PlaneData} data @param {{position: string, velocity: string}} units @param {boolean} trail whether it leaves one */
  show(data, units, trail) {
    this.units = units;
    this.trails = trail;
    const { beta, sigma } = data.point;
    const last = this.trail[this.trail.length - 1];
    if (trail && beta !== null && sigma !== null && (!last || last.beta !== beta || last.sigma !== sigma)) this.trail.push({ beta, sigma });
    if (this.trail.length > TRAIL) this.trail.shift();
    this.data = data;
    this.draw();
    this.tell();
  }

  /** A setting not yet sent, and the boundaries that would hold there; null: none. @param {PlaneData | null} data */
  dream(data) {
    this.ghost = data;
    if (!data) {
      say("ghost-words", "");
    } else {
      const { region, region_here: here, words_here: words, deflection } = data.point;
      const place = region === here ? here : `${region}, that is ${here} for a release from ${number(deflection)} ticks`;
      say("ghost-words", `would land in ${place}: ${words}`);
    }
    this.draw();
  }

  tell() {
    if (!this.data) return;
    const { point } = this.data;
    say("region", point.region);
    say("region-words", point.words);
    say("beta", number(point.beta));
    say("sigma", number(point.sigma));
    say("mu", number(point.mu));
    say("tau-d", number(point.tau_d));
    const speed = point.velocity_limit;
    const way = point.deflection_limit;
    say("limit-velocity", speed.si === null ? "none" : `${number(speed.si)} ${this.units.velocity} = ${number(speed.ticks_per_period)} ticks/period`);
    say("limit-deflection", way.ticks === null ? "none" : `${number(way.ticks)} ticks = ${number(way.si)} ${this.units.position}`);
    say("region-here", `${point.region_here} for a release from ${number(point.deflection)} ticks`);
    say("cycle", point.cycle ? `${number(point.cycle.hz)} Hz, ±${number(point.cycle.ticks)} ticks` : "none");
  }

  /** @param {number} beta */
  x(beta) {
    const [low, high] = DECADES.beta;
    const at = (Math.log10(Math.max(beta, 1e-30)) - low) / (high - low);
    return LEFT + Math.min(1, Math.max(0, at)) * (WIDTH - LEFT - RIGHT);
  }

  /** @param {number} sigma */
  y(sigma) {
    const [low, high] = DECADES.sigma;
    const at = (Math.log10(Math.max(sigma, 1e-30)) - low) / (high - low);
    return HEIGHT - BOTTOM - Math.min(1, Math.max(0, at)) * (HEIGHT - TOP - BOTTOM);
  }

  draw() {
    const { data } = this;
    const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-labelledby": "plane-title" });
    root.append(svg("title", { id: "plane-title" }, data ? `Stability plane: region ${data.point.region}, ${data.point.words}` : "Stability plane"));
    if (data) this.fields(root, data);
    this.axes(root);
    if (data) this.points(root, data);
    this.place.replaceChildren(root);
  }

  /** @param {SVGElement} root @param {PlaneData} data */
  fields(root, data) {
    const delayed = data.point.tau_d > 0;
    const [x0, x1] = [LEFT, WIDTH - RIGHT];
    const [y0, y1] = [HEIGHT - BOTTOM, TOP];
    const line = this.x(data.beta_line);
    const floor = this.y(data.sigma_line);
    const box = (/** @type {string} */ region, /** @type {number} */ left, /** @type {number} */ right, /** @type {number} */ bottom, /** @type {number} */ top) =>
      root.append(svg("rect", { class: `field ${region}`, x: left, y: top, width: Math.max(0, right - left), height: Math.max(0, bottom - top) }));
    box("C", x0, line, y0, floor);
    box("B", line, x1, y0, floor);
    box("D", x0, line, floor, y1);
    box(delayed ? "F2" : "A", line, x1, floor, y1);
    // above the boundary: E left of the line, F1 right of it; F2 is what little it leaves between ½ + τ_D and λ
    const above = (/** @type {string} */ region, /** @type {(beta: number) => boolean} */ within, /** @type {number} */ left, /** @type {number} */ right) => {
      const points = data.beta.map((beta, i) => ({ beta, sigma: data.paper[i] })).filter(({ beta }) => within(beta));
      if (!points.length) return;
      const corner = (/** @type {number} */ x, /** @type {number | null} */ sigma) => `${x},${sigma === null ? y1 : Math.min(floor, this.y(sigma))}`;
      const edge = points.map(({ beta, sigma }) => corner(this.x(beta), sigma));
      const outline = [`${left},${y1}`, corner(left, points[0].sigma), ...edge, corner(right, points[points.length - 1].sigma), `${right},${y1}`];
      root.append(svg("polygon", { class: `field ${region}`, points: outline.join(" ") }));
    };
    above("E", (beta) => beta <= data.beta_line && this.x(beta) > x0, x0, line);
    if (delayed) above("F1", (beta) => beta >= data.beta_line && this.x(beta) < x1, line, x1);
    const curve = (/** @type {string} */ kind, /** @type {(number | null)[]} */ values) => {
      const path = [];
      let down = false;
      for (const [i, beta] of data.beta.entries()) {
        const sigma = values[i];
        const inside = sigma !== null && this.x(beta) > x0 && this.x(beta) < x1 && this.y(sigma) > y1;
        if (inside) path.push(`${down ? "L" : "M"}${this.x(beta).toFixed(1)},${this.y(sigma).toFixed(1)}`);
        down = inside;
      }
      if (path.length) root.append(svg("path", { class: `boundary ${kind}`, d: path.join("") }));
    };
    if (this.ghost) curve("unsent", this.ghost.paper);
    curve("paper", data.paper);
    root.append(svg("path", { class: "boundary fixed", d: `M${line},${y0}V${y1}M${x0},${floor}H${x1}` }));
    const name = (/** @type {string} */ text, /** @type {number} */ x, /** @type {number} */ y) => root.append(svg("text", { class: "name", x, y }, text));
    name("C", (x0 + line) / 2, (y0 + floor) / 2 + 5);
    name("B", (line + x1) / 2, (y0 + floor) / 2 + 5);
    this.band(root, data, x0, floor);
    name("E", (x0 + line) / 2, y1 + 18);
    name(delayed ? "F1" : "A", (line + x1) / 2, (floor + y1) / 2);
  }

  /** The letter of D, which is often a narrow band: small where there is little room. @param {SVGElement} root @param {PlaneData} data @param {number} x0 @param {number} floor */
  band(root, data, x0, floor) {
    const top = Math.min(...data.beta.map((beta, i) => (this.x(beta) > x0 ? this.y(data.paper[i] ?? Infinity) : floor)));
    const room = floor - top;
    if (room > 8) root.append(svg("text", { class: room > 18 ? "name" : "name small", x: x0 + 16, y: (floor + top) / 2 + (room > 18 ? 5 : 4) }, "D"));
  }

  /** @param {SVGElement} root */
  axes(root) {
    const label = (/** @type {number} */ exponent) => (exponent === 0 ? "1" : exponent === 1 ? "10" : exponent === -1 ? "0.1" : exponent === -2 ? "0.01" : exponent === 2 ? "100" : "1000");
    for (let e = DECADES.beta[0]; e <= DECADES.beta[1]; e++) root.append(svg("text", { class: "tick", x: this.x(10 ** e), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, label(e)));
    for (let e = DECADES.sigma[0]; e <= DECADES.sigma[1]; e++) root.append(svg("text", { class: "tick", x: LEFT - 4, y: this.y(10 ** e) + 4, "text-anchor": "end" }, label(e)));
    root.append(svg("text", { class: "axis", x: (LEFT + WIDTH) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, "β  viscous friction"));
    root.append(svg("text", { class: "axis", "text-anchor": "middle", transform: `translate(11 ${(HEIGHT - BOTTOM) / 2}) rotate(-90)` }, "σ  Coulomb friction"));
  }

  /** @param {SVGElement} root @param {PlaneData} data */
  points(root, data) {
    const { beta, sigma } = data.point;
    if (beta === null || sigma === null) return;
    const trail = (this.trails ? this.trail : []).map((point) => `${this.x(point.beta).toFixed(1)},${this.y(point.sigma).toFixed(1)}`);
    root.append(svg("polyline", { class: "trail", points: trail.join(" ") }));
    for (const point of this.trails ? this.trail.slice(0, -1) : []) root.append(svg("circle", { class: "trail-dot", cx: this.x(point.beta), cy: this.y(point.sigma), r: 2 }));
    const ghost = this.ghost?.point;
    if (ghost && ghost.beta !== null && ghost.sigma !== null) {
      const [x, y] = [this.x(ghost.beta), this.y(ghost.sigma)];
      root.append(svg("path", { class: "trail ghost-way", d: `M${this.x(beta)},${this.y(sigma)}L${x},${y}` }));
      root.append(svg("circle", { class: "ghost", id: "ghost", cx: x, cy: y, r: 6 }));
    }
    root.append(svg("circle", { class: "point", id: "point", cx: this.x(beta), cy: this.y(sigma), r: 5 }));
  }
}
