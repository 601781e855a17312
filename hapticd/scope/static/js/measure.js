// Numbers of what lies between the cursors, and its spectrum.
// @ts-check

import { byId, duration, number, say } from "./dom.js";
import { LOOK, colour } from "./lane.js";

const LONGEST_SPECTRUM = 1 << 16;

/**
 * Mean, RMS and peak-to-peak of a channel's rows; what is not a number is left out.
 * @param {import("./store.js").Store} store @param {import("./store.js").Channel} channel @param {number} begin @param {number} end
 */
export function statistics(store, channel, begin, end) {
  const { values } = store.channels[channel];
  let [count, sum, squares, low, high] = [0, 0, 0, Infinity, -Infinity];
  for (let row = begin; row < end; row++) {
    const value = values[row & store.mask];
    if (!Number.isFinite(value)) continue;
    count++;
    sum += value;
    squares += value * value;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!count) return { count, mean: NaN, rms: NaN, peakToPeak: NaN };
  return { count, mean: sum / count, rms: Math.sqrt(squares / count), peakToPeak: high - low };
}

/**
 * Fourier transform in place, radix 2; the length is a power of two.
 * @param {Float64Array} re @param {Float64Array} im
 */
export function fft(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [re[i], re[j]] = [re[j], re[i]];
      [im[i], im[j]] = [im[j], im[i]];
    }
  }
  for (let size = 2; size <= n; size <<= 1) {
    const angle = (-2 * Math.PI) / size;
    for (let k = 0; k < size / 2; k++) {
      const [c, s] = [Math.cos(angle * k), Math.sin(angle * k)];
      for (let start = k; start < n; start += size) {
        const other = start + size / 2;
        const x = re[other] * c - im[other] * s;
        const y = re[other] * s + im[other] * c;
        re[other] = re[start] - x;
        im[other] = im[start] - y;
        re[start] += x;
        im[start] += y;
      }
    }
  }
}

/**
 * Amplitude spectrum (peak of a sine, the channel's unit) of the longest stretch without a gap, Hann window, mean removed.
 * @param {import("./store.js").Store} store @param {import("./store.js").Channel} channel @param {number} begin @param {number} end
 * @returns {{hz: Float64Array, amplitude: Float64Array, rows: number} | null} null where there are too few rows
 */
export function spectrum(store, channel, begin, end) {
  const stops = [begin, ...store.gapsWithin(begin, end).map((gap) => gap.row), end];
  let best = 0;
  for (let i = 1; i < stops.length - 1; i++) if (stops[i + 1] - stops[i] > stops[best + 1] - stops[best]) best = i;
  const from = stops[best];
  const rows = Math.min(stops[best + 1] - from, LONGEST_SPECTRUM);
  if (rows < 32) return null;
  const values = new Float64Array(rows);
  for (let i = 0; i < rows; i++) values[i] = store.value(channel, from + i);
  if (values.some((value) => !Number.isFinite(value))) return null;
  const mean = values.reduce((sum, value) => sum + value, 0) / rows;
  const n = 1 << Math.ceil(Math.log2(rows));
  const [re, im] = [new Float64Array(n), new Float64Array(n)];
  for (let i = 0; i < rows; i++) re[i] = (values[i] - mean) * (0.5 - 0.5 * Math.cos((2 * Math.PI * (i + 0.5)) / rows));
  fft(re, im);
  const rate = (rows - 1) / (store.timeAt(from + rows - 1) - store.timeAt(from));
  const hz = new Float64Array(n / 2 - 1);
  const amplitude = new Float64Array(n / 2 - 1);
  for (let k = 1; k < n / 2; k++) {
    hz[k - 1] = (k * rate) / n;
    amplitude[k - 1] = (4 * Math.hypot(re[k], im[k])) / rows; // a Hann window halves a sine
  }
  return { hz, amplitude, rows };
}

export class Measure {
  constructor() {
    /** @type {uPlot | null} */ this.plot = null;
    this.predicted = NaN;
  }

  /**
   * Tell all about the selection.
   * @param {import("./store.js").Store} store @param {import("./trace.js").Trace} trace
   * @param {import("./store.js").Channel} channel @param {{unit: string, perTick: number}} scale
   */
  tell(store, trace, channel, scale) {
    const { a, b } = trace.cursors;
    const [from, to] = Number.isFinite(a) && Number.isFinite(b) ? [Math.min(a, b), Math.max(a, b)] : [trace.view[0] + trace.zero, trace.view[1] + trace.zero];
    const [begin, end] = [store.rowAt(from), store.rowAt(to)];
    const both = (/** @type {number} */ value) =>
      scale.perTick ? `${number(value)} ticks = ${number(value * scale.perTick)} ${scale.unit}` : `${number(value)} ${scale.unit}`;
    const dt = to - from;
    say("m-dt", Number.isFinite(a) && Number.isFinite(b) ? duration(dt) : "set cursors A and B");
    say("m-hz", Number.isFinite(a) && Number.isFinite(b) && dt > 0 ? `${number(1 / dt)} Hz` : "–");
    const at = (/** @type {number} */ time) => (Number.isFinite(time) && store.head ? store.value(channel, Math.min(store.rowAt(time), store.head - 1)) : NaN);
    say("m-dy", Number.isFinite(at(a) - at(b)) ? both(at(b) - at(a)) : "–");
    const { y1, y2 } = trace.values;
    say("m-y", Number.isFinite(y2 - y1) ? both(y2 - y1) : "–");
    const found = statistics(store, channel, begin, end);
    say("m-mean", both(found.mean));
    say("m-rms", both(found.rms));
    say("m-pp", both(found.peakToPeak));
    say("m-rows", `${found.count} rows of ${LOOK[channel].label}${Number.isFinite(a) && Number.isFinite(b) ? " between A and B" : " in view"}`);
    return { begin, end };
  }

  /**
   * @param {import("./store.js").Store} store @param {import("./store.js").Channel} channel
   * @param {number} begin @param {number} end @param {number} predictedHz
   */
  draw(store, channel, begin, end, predictedHz) {
    const place = byId("spectrum");
    const found = spectrum(store, channel, begin, end);
    this.predicted = predictedHz;
    if (!found) {
      say("spectrum-peak", "too few rows without a gap");
      return;
    }
    let peak = 0;
    found.amplitude.forEach((value, i) => (peak = value > found.amplitude[peak] ? i : peak));
    const expected = Number.isFinite(predictedHz) ? `; the describing function predicts ${number(predictedHz)} Hz` : "";
    say("spectrum-peak", `peak ${number(found.amplitude[peak])} at ${number(found.hz[peak])} Hz${expected}`);
    const data = /** @type {uPlot.AlignedData} */ (/** @type {unknown} */ ([found.hz, found.amplitude.map((value) => Math.max(value, 1e-12))]));
    if (!this.plot) {
      const axis = { stroke: () => colour("--ink-2"), grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
      this.plot = new uPlot(
        {
          width: place.clientWidth || 380,
          height: 150,
          legend: { show: false },
          scales: { x: { time: false, distr: 3 }, y: { distr: 3 } },
          axes: [{ ...axis, size: 22, values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : number(tick, 3))) }, { ...axis, size: 52, values: (_, ticks) => ticks.map((tick) => (tick === null ? "" : number(tick, 2))) }],
          series: [{}, { stroke: () => colour("--c1"), width: 1, points: { show: false } }],
          hooks: { draw: [(plot) => this.mark(plot)] },
        },
        data,
        place,
      );
    } else {
      this.plot.setData(data);
    }
  }

  /** @param {uPlot} plot */
  mark(plot) {
    const { min, max } = plot.scales.x;
    if (!(this.predicted >= (min ?? NaN) && this.predicted <= (max ?? NaN))) return;
    const { ctx, bbox } = plot;
    const x = plot.valToPos(this.predicted, "x", true);
    ctx.save();
    ctx.strokeStyle = colour("--trigger");
    ctx.setLineDash([4, 3]);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.restore();
  }
}
