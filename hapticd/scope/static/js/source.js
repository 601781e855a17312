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

/** What a channel is counted in. @param {import("./store.js").Channel} channel @param {Source} source */
export function channelUnit(channel, { units }) {
  return { position: "ticks", coarse: "ticks", model: "ticks", residual: "ticks", velocity: units.velocity, current: "A", measured: "A", force: units.force, late: "µs" }[channel];
}

/**
 * The lanes, of whatever is looked at.
 * @param {() => Source} source
 * @returns {import("./lane.js").LaneSpec[]}
 */
export function makeLanes(source) {
  const ticks = () => `ticks of ${number(source().scales.resolution, 3)} ${source().units.position}`;
  return [
    { id: "position", title: "Position", channels: ["position", "coarse", "model"], shown: true, unit: ticks },
    { id: "residual", title: "Residual", channels: ["residual"], shown: false, unit: ticks },
    { id: "velocity", title: "Velocity", channels: ["velocity"], shown: false, unit: () => `${source().units.velocity}, slope over 5 ms` },
    { id: "current", title: "Current", channels: ["current", "measured"], shown: true, unit: () => "A" },
    { id: "force", title: "Force", channels: ["force"], shown: false, unit: () => source().units.force },
    { id: "late", title: "Lateness", channels: ["late"], shown: false, unit: () => "µs" },
  ];
}
