// What can be looked at: rows, each with the units, the scales, the config and the plane of their own. There is the capture of
// the live rows, which never stops, and there are runs out of files.
// @ts-check

import { number } from "./dom.js";
import { Store } from "./store.js";

/**
 * @typedef {object} Source
 * @property {string} name of the file; empty: the live rows
 * @property {Store} store
 * @property {{position: string, velocity: string, current: string, force: string}} units
 * @property {{resolution: number, raw_resolution: number, decimation: number, period_s: number}} scales
 * @property {any} config null where it is not known
 * @property {import("./plane.js").PlaneData | null} plane
 * @property {import("./notes.js").Mark[]} marks notes and markers
 * @property {{name: string, begin: number, end: number}[]} runs recordings of these rows, from when to when
 * @property {string} created when the file was recorded, UTC; empty where it does not say, and for live rows
 */

/** @param {string} name @param {Store} store @returns {Source} */
export function makeSource(name, store) {
  return {
    name,
    store,
    units: { position: "rad", velocity: "rad/s", current: "A", force: "N m" },
    scales: { resolution: 1, raw_resolution: 1, decimation: 1, period_s: 1e-3 },
    config: null,
    plane: null,
    marks: [],
    runs: [],
    created: "",
  };
}

/**
 * Take over what the server says of a config: `hapticd.scope.theory.describe`.
 * @param {Source} source @param {{units: any, scales: any, config: any, plane: any}} message
 */
export function describe(source, { units, scales, config, plane }) {
  Object.assign(source, { units, scales, config, plane });
  source.store.rawResolution = scales.raw_resolution;
}

/** Units of place, and how many of the source's own (rad or m) one is. @param {Source} source @returns {Record<string, number>} */
export function placeUnits({ units, scales }) {
  const ticks = { ticks: scales.resolution };
  if (units.position === "rad") return { ...ticks, rad: 1, deg: Math.PI / 180 };
  if (units.position === "m") return { ...ticks, m: 1, mm: 1e-3 };
  return { ticks: 1 };
}

/** Round values from low to high, about so many. @param {number} low @param {number} high @param {number} count */
export function ticksOf(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step);
  return ticks;
}

/** What a channel is counted in. @param {import("./store.js").Channel} channel @param {Source} source */
export function channelUnit(channel, { units }) {
  return { position: "ticks", coarse: "ticks", model: "ticks", residual: "ticks", velocity: units.velocity, current: "A", measured: "A", force: units.force, late: "µs", derived1: "", derived2: "" }[channel];
}

/** In which unit places are shown; one that a source has not is its ticks. @type {{unit: string}} */
export const place = { unit: "ticks" };

const PLACES = new Set(["position", "coarse", "model", "residual"]);

/**
 * In what a channel is shown, and how many of that one of its own unit is.
 * @param {import("./store.js").Channel} channel @param {Source} source @returns {{unit: string, factor: number}}
 */
export function shownIn(channel, source) {
  const units = placeUnits(source);
  const unit = place.unit in units ? place.unit : "ticks";
  if (unit !== "ticks" && PLACES.has(channel)) return { unit, factor: units.ticks / units[unit] };
  if (unit !== "ticks" && channel === "velocity") return { unit: `${unit}/s`, factor: 1 / units[unit] };
  return { unit: channelUnit(channel, source), factor: 1 };
}

/**
 * The lanes, of whatever is looked at.
 * @param {() => Source} source
 * @returns {import("./lane.js").LaneSpec[]}
 */
export function makeLanes(source) {
  const ticks = () => {
    const { unit } = shownIn("position", source());
    return unit === "ticks" ? `ticks of ${number(source().scales.resolution, 3)} ${source().units.position}` : unit;
  };
  return [
    { id: "position", title: "Position", channels: ["position", "coarse", "model"], shown: true, unit: ticks },
    { id: "residual", title: "Residual", channels: ["residual"], shown: false, unit: ticks },
    { id: "velocity", title: "Velocity", channels: ["velocity"], shown: false, unit: () => `${shownIn("velocity", source()).unit}, slope over 5 ms` },
    { id: "current", title: "Current", channels: ["current", "measured"], shown: true, unit: () => "A" },
    { id: "force", title: "Force", channels: ["force"], shown: false, unit: () => source().units.force },
    { id: "late", title: "Lateness", channels: ["late"], shown: false, unit: () => "µs" },
  ];
}
