// A picture for a lab book: the lanes and the X–Y lane as they are seen, on light paper, with legend, settings, run and date.
// @ts-check

import { byId, number } from "./dom.js";
import { LOOK } from "./lane.js";
import { widthOf } from "./scene.js";
import { shownIn, ticksOf } from "./source.js";

/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {(import("./scene.js").Line | import("./scene.js").Rect | import("./scene.js").Text)[]} Items */
/** @typedef {{left: number, top: number, width: number, height: number}} Box */

const WIDTH = 1000;
const LEFT = 70;
const RIGHT = 16;
const LANE = 170;
const XY = 380;
const MOST_RUNS = 64;
/** Never settled by a dark screen: the colours of the light theme. @type {Map<string, string>} */
const paper = new Map();

/** @param {string} name */
function ink(name) {
  if (!paper.size) {
    for (const sheet of document.styleSheets) {
      if (!sheet.href?.endsWith("/style.css")) continue;
      const light = [...sheet.cssRules].find((rule) => rule instanceof CSSStyleRule && rule.selectorText === ":root");
      for (const key of /** @type {CSSStyleRule} */ (light).style) paper.set(key, /** @type {CSSStyleRule} */ (light).style.getPropertyValue(key).trim());
    }
  }
  return paper.get(name) ?? "#000000";
}

/** A recording of live rows goes on, or has ended. @param {import("./source.js").Source} live @param {string | null} path */
export function noteRun(live, path) {
  const now = live.store.head ? live.store.timeAt(live.store.head - 1) : 0;
  const last = live.runs[live.runs.length - 1];
  const name = path?.split("/").pop() ?? "";
  if (last && last.end === Infinity && last.name !== name) last.end = now;
  if (name && last?.name !== name) live.runs.push({ name, begin: now, end: Infinity });
  if (live.runs.length > MOST_RUNS) live.runs.shift();
}

/** A recording of live rows that are known: the state may tell of it when it is over. @param {import("./source.js").Source} live @param {string} path @param {number} begin @param {number} end its rows */
export function nameRun(live, path, begin, end) {
  const name = path.split("/").pop() ?? "";
  live.runs = live.runs.filter((run) => run.name !== name);
  live.runs.push({ name, begin: live.store.timeAt(begin), end: live.store.timeAt(end - 1) });
}

/** What these rows are of. @param {import("./view.js").View} view */
function nameOf({ source, trace }) {
  if (source.name) return source.name;
  const [from, to] = trace.view.map((time) => time + trace.zero);
  const names = source.runs.filter(({ begin, end }) => begin < to && end > from).map(({ name }) => name);
  return names.join(", ") || "live, not recorded";
}

/** @type {Intl.DateTimeFormatOptions} */
const STAMP = {
  year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit", timeZoneName: "short",
};

/** Local date and time, with the zone: of the file, or, of live rows, now. @param {import("./source.js").Source} source */
function dateOf({ name, created }) {
  if (name && !created) return "no date";
  const when = created ? new Date(created) : new Date();
  return Number.isNaN(when.getTime()) ? created : when.toLocaleString("sv-SE", STAMP);
}

/** The settings in words: what the loop does, and where that is in the plane. @param {import("./source.js").Source} source @returns {string[]} */
function settingsOf({ config, units, plane }) {
  if (!config) return ["no config is known"];
  const { spring, servo, encoder, delay, dither, record } = config;
  const linear = units.position === "m";
  const first = [
    `K = ${number(spring.stiffness)} ${linear ? "N/m" : "N m/rad"}`,
    `B = ${number(spring.damping)} ${linear ? "N s/m" : "N m s/rad"}`,
    `N = ${number(encoder.decimation)}`,
    `1/T = ${number(servo.rate_hz)} Hz`,
    `T_V = ${number(delay.computation_s * 1e3)} ms`,
    ...(dither.target === "none" ? [] : [`dither ${dither.waveform} ${number(dither.amplitude)} ${dither.target === "current" ? "A" : "ticks"} ${number(dither.frequency_hz)} Hz`]),
    ...(spring.side === "both" ? [] : [`wall ${spring.side}`]),
  ];
  const point = plane?.point;
  const second = point ? [`β = ${number(point.beta)}`, `σ = ${number(point.sigma)}`, `μ = ${number(point.mu)}`, `τ_D = ${number(point.tau_d)}`, `region ${point.region}`] : [];
  const of = [...(record?.subject ? [`subject ${record.subject}`] : []), ...(record?.condition ? [`condition ${record.condition}`] : [])];
  return [first.join(", "), [...second, ...of].join(", ")].filter(Boolean);
}

/**
 * Axes, grid and their numbers.
 * @param {Items} items @param {Box} box @param {[number, number]} x @param {[number, number]} y @param {boolean} numbered whether the x axis has numbers
 */
function axes(items, box, x, y, numbered) {
  const at = (/** @type {number} */ value) => box.left + ((value - x[0]) / (x[1] - x[0])) * box.width;
  const up = (/** @type {number} */ value) => box.top + box.height - ((value - y[0]) / (y[1] - y[0])) * box.height;
  for (const value of ticksOf(x[0], x[1], box.width / 90)) {
    items.push({ kind: "line", points: [[at(value), box.top], [at(value), box.top + box.height]], stroke: ink("--grid") });
    if (numbered) items.push({ kind: "text", x: at(value), y: box.top + box.height + 14, text: number(value, 6), fill: ink("--ink-2"), anchor: "middle" });
  }
  for (const value of ticksOf(y[0], y[1], box.height / 34)) {
    items.push({ kind: "line", points: [[box.left, up(value)], [box.left + box.width, up(value)]], stroke: ink("--grid") });
    items.push({ kind: "text", x: box.left - 5, y: up(value) + 4, text: number(value, 4), fill: ink("--ink-2"), anchor: "end" });
  }
  const clip = (/** @type {number} */ value) => Math.min(box.top + box.height, Math.max(box.top, value));
  return { at, up: (/** @type {number} */ value) => clip(up(value)) };
}

/** A curve in a box; a held value as the steps that it is. @param {ArrayLike<number | null>} x @param {ArrayLike<number | null | undefined>} y @param {{at: (value: number) => number, up: (value: number) => number}} to @param {boolean} held */
function points(x, y, to, held) {
  /** @type {(number | null)[][]} */ const found = [];
  let before = null;
  for (let i = 0; i < x.length; i++) {
    const [place, value] = [x[i], y[i]];
    if (place === null || value === null || value === undefined || !Number.isFinite(value) || !Number.isFinite(place)) {
      found.push([null, null]);
      before = null;
      continue;
    }
    if (held && before !== null) found.push([to.at(place), before]);
    before = to.up(value);
    found.push([to.at(place), before]);
  }
  return found;
}

/** The legend, from the right. @param {Items} items @param {number} right @param {number} y @param {{label: string, colour: string, dash?: number[]}[]} entries */
function legend(items, right, y, entries) {
  let x = right;
  for (const { label, colour, dash } of [...entries].reverse()) {
    x -= widthOf(label);
    items.push({ kind: "text", x, y, text: label, fill: ink("--ink") });
    items.push({ kind: "line", points: [[x - 24, y - 4], [x - 5, y - 4]], stroke: ink(colour), width: 2, dash });
    x -= 40;
  }
}

/** @param {Items} items @param {Box} box @param {import("./lane.js").Lane} lane @param {import("./view.js").View} view @param {boolean} last */
function drawLane(items, box, lane, view, last) {
  const { trace, source } = view;
  const to = axes(items, box, trace.view, lane.range, last);
  items.push({ kind: "text", x: box.left, y: box.top - 7, text: `${lane.spec.title} (${lane.spec.unit()})`, fill: ink("--ink"), bold: true });
  legend(items, box.left + box.width, box.top - 7, lane.spec.channels.map((channel) => ({ ...LOOK[channel] })));
  for (const gap of trace.gaps) {
    const [left, right] = [gap.row - 1, gap.row].map((row) => Math.min(box.left + box.width, Math.max(box.left, to.at(source.store.timeAt(row) - trace.zero))));
    items.push({ kind: "rect", x: left, y: box.top, width: Math.max(right - left, 1.5), height: 3, fill: ink("--gap") });
  }
  const upright = (/** @type {number} */ time, /** @type {string} */ colour, /** @type {number[]} */ dash, /** @type {string} */ label) => {
    if (!(time >= trace.view[0] && time <= trace.view[1])) return;
    items.push({ kind: "line", points: [[to.at(time), box.top], [to.at(time), box.top + box.height]], stroke: ink(colour), dash });
    if (label) items.push({ kind: "text", x: to.at(time) + 3, y: box.top + 11, text: label, fill: ink(colour) });
  };
  for (const { time, words } of source.marks) upright(time - trace.zero, "--ink-2", [1, 3], lane === trace.lanes[0] ? words : "");
  upright(trace.triggerTime - trace.zero, "--trigger", [2, 3], "T");
  upright(trace.cursors.a - trace.zero, "--ink", [], "A");
  upright(trace.cursors.b - trace.zero, "--ink", [], "B");
  const [x, ...curves] = lane.plot.data;
  lane.spec.channels.forEach((channel, i) => {
    const { colour, dash, held } = LOOK[channel];
    items.push({ kind: "line", points: points(x, curves[i] ?? [], to, Boolean(held && lane.raw)), stroke: ink(colour), width: 1.25, dash });
  });
}

/** What is seen. @param {import("./view.js").View} view @param {import("./xy.js").XY} xy @returns {Scene} */
export function compose(view, xy) {
  const { trace, source } = view;
  /** @type {Items} */ const items = [];
  const shown = byId("xy").hidden ? null : xy.painted;
  const lanes = byId("lanes").hidden ? [] : trace.lanes;
  const head = [`${shownIn("position", source).unit === "ticks" ? `1 tick = ${number(source.scales.resolution, 4)} ${source.units.position}; ` : ""}${settingsOf(source)[0]}`, ...settingsOf(source).slice(1)];
  let top = 34 + 16 * head.length;
  const height = top + lanes.length * (LANE + 26) + (lanes.length ? 22 : 0) + (shown ? XY + 60 : 0) + 12;
  items.push({ kind: "rect", x: 0, y: 0, width: WIDTH, height, fill: "#ffffff" });
  items.push({ kind: "text", x: 14, y: 24, text: nameOf(view), fill: ink("--ink"), size: 15, bold: true });
  items.push({ kind: "text", x: WIDTH - RIGHT, y: 24, text: dateOf(source), fill: ink("--ink-2"), size: 12, anchor: "end" });
  head.forEach((text, i) => items.push({ kind: "text", x: 14, y: 44 + 16 * i, text, fill: ink("--ink-2"), size: 12 }));
  lanes.forEach((lane, i) => {
    top += 26;
    drawLane(items, { left: LEFT, top, width: WIDTH - LEFT - RIGHT, height: LANE }, lane, view, i === lanes.length - 1);
    top += LANE;
  });
  if (lanes.length) {
    items.push({ kind: "text", x: (LEFT + WIDTH - RIGHT) / 2, y: top + 28, text: "time (s)", fill: ink("--ink-2"), anchor: "middle" });
    top += 22;
  }
  if (shown) {
    top += 34;
    const box = { left: LEFT, top, width: WIDTH - LEFT - RIGHT, height: XY - 10 };
    const to = axes(items, box, shown.x, shown.y, true);
    items.push({ kind: "text", x: LEFT, y: top - 7, text: shown.title, fill: ink("--ink"), bold: true });
    const ideal = { label: "ideal spring", colour: "--ink", dash: [6, 4] };
    legend(items, WIDTH - RIGHT, top - 7, [{ label: "measured", colour: "--c1" }, ...(shown.old.length ? [{ label: "releases before", colour: "--c3" }] : []), ...(shown.ideal.length ? [ideal] : [])]);
    for (const each of shown.old) items.push({ kind: "line", points: points(each.x, each.y, to, false), stroke: ink("--c3"), alpha: 0.35 });
    items.push({ kind: "line", points: points(shown.now.x, shown.now.y, to, false), stroke: ink("--c1"), width: 1.25 });
    for (const each of shown.ideal) items.push({ kind: "line", points: points(each.x, each.y, to, false), stroke: ink("--ink"), dash: [6, 4] });
  }
  return { width: WIDTH, height: Math.round(height), items };
}
