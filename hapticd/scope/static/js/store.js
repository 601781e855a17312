// What the page holds: the newest rows in rings of fixed size, a pyramid of minima and maxima over them, and the gaps.
// @ts-check

export const CAPACITY = 1 << 20;
/** A block of level l covers 16^l rows. */
const FACTOR_BITS = 4;
const LEVELS = 4;
const MAX_GAPS = 4096;
/** One block of the highest level. */
export const SMALLEST = 1 << 16;
/** Over how long the velocity is the slope of the position, s. */
export const VELOCITY_WINDOW_S = 0.005;

/** Channels, in the order of the page. @typedef {"position"|"coarse"|"velocity"|"current"|"measured"|"force"|"late"|"model"|"residual"|"derived1"|"derived2"} Channel */
/** @type {Channel[]} */
export const CHANNELS = ["position", "coarse", "velocity", "current", "measured", "force", "late", "model", "residual", "derived1", "derived2"];
/** Those that an expression makes of the others. @type {Channel[]} */
export const DERIVED = ["derived1", "derived2"];
const RECORDED = CHANNELS.filter((name) => !DERIVED.includes(name));

/**
 * @typedef {object} Gap
 * @property {number} row the row before which something is missing
 * @property {number} ticks how many ticks
 * @property {"missed" | "lost" | "restart"} kind periods that the servo loop missed; rows that did not come here; another
 *   servo loop
 */

class Pyramid {
  /** @param {number} capacity */
  constructor(capacity) {
    this.values = new Float32Array(capacity).fill(NaN);
    /** @type {Float32Array[]} */ this.low = [];
    /** @type {Float32Array[]} */ this.high = [];
    for (let level = 1; level <= LEVELS; level++) {
      this.low.push(new Float32Array(capacity >> (FACTOR_BITS * level)));
      this.high.push(new Float32Array(capacity >> (FACTOR_BITS * level)));
    }
  }
}

export class Store {
  /** @param {number} capacity rows held, a power of 16 times a power of two */
  constructor(capacity = CAPACITY) {
    this.capacity = capacity;
    this.mask = capacity - 1;
    this.time = new Float64Array(capacity);
    this.tick = new Float64Array(capacity);
    this.counts = new Int32Array(capacity);
    this.flags = new Uint16Array(capacity);
    this.epochs = new Uint32Array(capacity);
    /** @type {Record<Channel, Pyramid>} */
    this.channels = /** @type {any} */ ({});
    for (const name of RECORDED) this.channels[name] = new Pyramid(capacity);
    /** Raw counts in a coarse tick, of the newest rows. */
    this.decimation = 1;
    this.rawResolution = 1;
    /** Rows ever taken: the number of the next one. @type {number} */
    this.head = 0;
    /** @type {Gap[]} */ this.gaps = [];
    this.missed = 0;
    this.lost = 0;
    this.nextRow = -1;
    this.shift = 0;
    this.originCounts = 0;
    /** The first row counted from the present origin. */
    this.originRow = 0;
    this.periodS = 1e-3;
    /** What a row of a derived channel is. @type {Map<Channel, (row: number) => number>} */
    this.rules = new Map();
  }

  /** The oldest row that is there. */
  get first() {
    return Math.max(0, this.head - this.capacity);
  }

  /** Memory of the rows, in bytes. */
  get bytes() {
    const pyramid = this.channels.position;
    const perChannel = pyramid.values.byteLength + 2 * pyramid.low.reduce((sum, level) => sum + level.byteLength, 0);
    return perChannel * Object.keys(this.channels).length + this.capacity * (8 + 8 + 4 + 2 + 4);
  }

  /** @param {number} row */
  timeAt(row) {
    return this.time[row & this.mask];
  }

  /** @param {Channel} channel @param {number} row */
  value(channel, row) {
    return this.channels[channel]?.values[row & this.mask] ?? NaN;
  }

  /** The first row at or after a time. @param {number} time */
  rowAt(time) {
    let low = this.first;
    let high = this.head;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.timeAt(middle) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The row of a servo tick of the loop at hand, or the first after it where it has none; −1: it is not here (yet). @param {number} tick */
  rowOfTick(tick) {
    const restarts = this.gaps.filter((gap) => gap.kind === "restart");
    let low = Math.max(this.first, ...restarts.map((gap) => gap.row));
    let high = this.head;
    if (low >= high || tick < this.tick[low & this.mask] || tick > this.tick[(high - 1) & this.mask]) return -1;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.tick[middle & this.mask] < tick) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /**
   * Take a frame's rows.
   * @param {import("./frames.js").Frame} frame
   */
  append(frame) {
    const { rows } = frame;
    if (!rows) return;
    const { mask } = this;
    const before = this.head;
    const newLoop = before > 0 && frame.firstTick + frame.tickOffset[0] <= this.tick[(before - 1) & mask];
    const lost = this.nextRow >= 0 && !newLoop ? Math.max(0, frame.firstRow - this.nextRow) : 0;
    if (newLoop) {
      // Another servo loop began at zero: its time goes on after ours, one second further to the right.
      this.shift = this.timeAt(before - 1) + 1 - frame.timeS;
      this.gap({ row: before, ticks: 0, kind: "restart" });
    }
    this.nextRow = frame.firstRow + rows;
    this.periodS = frame.periodS;
    if (frame.originCounts !== this.originCounts) this.originRow = before;
    this.originCounts = frame.originCounts;
    const { position, coarse, velocity, current, measured, force, late, model, residual } = this.channels;
    const back = Math.max(1, Math.round(VELOCITY_WINDOW_S / frame.periodS));
    this.decimation = frame.decimation;
    const scale = 1 / frame.decimation;
    for (let i = 0; i < rows; i++) {
      const row = before + i;
      const at = row & mask;
      const tick = frame.firstTick + frame.tickOffset[i];
      if (row > 0 && !(newLoop && i === 0)) {
        const missing = tick - this.tick[(row - 1) & mask] - 1;
        if (missing > 0) {
          // Only between two frames can rows have been lost.
          const kind = i === 0 && lost > 0 ? "lost" : "missed";
          this.gap({ row, ticks: missing, kind });
        }
      }
      this.time[at] = frame.timeS + frame.timeOffset[i] + this.shift;
      this.tick[at] = tick;
      this.counts[at] = frame.counts[i];
      this.flags[at] = frame.flags[i];
      this.epochs[at] = frame.epoch;
      position.values[at] = frame.counts[i] * scale;
      coarse.values[at] = frame.ticks[i];
      current.values[at] = frame.current[i];
      measured.values[at] = frame.measured[i];
      force.values[at] = frame.force[i];
      late.values[at] = frame.late[i];
      model.values[at] = NaN;
      residual.values[at] = NaN;
      velocity.values[at] = this.slope(row, back);
    }
    this.head = before + rows;
    for (const name of RECORDED) this.build(name, before, this.head);
    this.derive(before, this.head);
    while (this.gaps.length && (this.gaps[0].row <= this.first || this.gaps.length > MAX_GAPS)) this.gaps.shift();
  }

  /** Make a derived channel, of the rows that are here and of those that come; null: it is empty. @param {Channel} name @param {((row: number) => number) | null} rule */
  define(name, rule) {
    if (rule) this.rules.set(name, rule);
    else this.rules.delete(name);
    this.channels[name] ??= new Pyramid(this.capacity);
    this.channels[name].values.fill(NaN);
    if (rule) this.derive(this.first, this.head);
    else this.build(name, this.first, this.head);
  }

  /** @param {number} begin @param {number} end */
  derive(begin, end) {
    for (const [name, rule] of this.rules) {
      const { values } = this.channels[name];
      for (let row = begin; row < end; row++) values[row & this.mask] = rule(row);
      this.build(name, begin, end);
    }
  }

  /** Slope of the position over the last rows, rad/s or m/s; not a number across a gap or a moved origin. @param {number} row @param {number} back */
  slope(row, back) {
    const then = row - back;
    if (then < Math.max(this.first, this.originRow)) return NaN;
    const { mask } = this;
    const gap = this.gaps[this.gaps.length - 1];
    if (gap && gap.row > then && gap.kind !== "missed") return NaN;
    const dt = this.time[row & mask] - this.time[then & mask];
    return ((this.counts[row & mask] - this.counts[then & mask]) * this.rawResolution) / dt;
  }

  /** @param {Gap} gap */
  gap(gap) {
    this.gaps.push(gap);
    if (gap.kind === "missed") this.missed += gap.ticks;
    if (gap.kind === "lost") this.lost += gap.ticks;
  }

  /** Bring the pyramid of a channel up to date for the rows from `begin` to `end`. @param {Channel} name @param {number} begin @param {number} end */
  build(name, begin, end) {
    const pyramid = this.channels[name];
    for (let level = 1; level <= LEVELS; level++) {
      const bits = FACTOR_BITS * level;
      const below = level === 1 ? pyramid.values : null;
      const blockMask = (this.capacity >> bits) - 1;
      const belowMask = (this.capacity >> (bits - FACTOR_BITS)) - 1;
      // only whole blocks: what is not whole is looked up a level lower
      for (let block = begin >> bits; (block + 1) << bits <= end; block++) {
        let low = Infinity;
        let high = -Infinity;
        for (let i = block << FACTOR_BITS; i < (block + 1) << FACTOR_BITS; i++) {
          const at = i & belowMask;
          const least = below ? below[at] : pyramid.low[level - 2][at];
          const most = below ? below[at] : pyramid.high[level - 2][at];
          if (least < low) low = least;
          if (most > high) high = most;
        }
        pyramid.low[level - 1][block & blockMask] = low;
        pyramid.high[level - 1][block & blockMask] = high;
      }
    }
  }

  /**
   * Smallest and largest value of the rows from `begin` to `end`; [∞, −∞] where there is none.
   * @param {Channel} name @param {number} begin @param {number} end @param {[number, number]} out
   */
  extent(name, begin, end, out) {
    const pyramid = this.channels[name];
    out[0] = Infinity;
    out[1] = -Infinity;
    if (!pyramid) return;
    let low = Infinity;
    let high = -Infinity;
    let row = begin;
    while (row < end) {
      let level = 0;
      while (level < LEVELS) {
        const bits = FACTOR_BITS * (level + 1);
        if (row & ((1 << bits) - 1) || row + (1 << bits) > end) break;
        level++;
      }
      const bits = FACTOR_BITS * level;
      const at = (row >> bits) & ((this.capacity >> bits) - 1);
      const least = level ? pyramid.low[level - 1][at] : pyramid.values[at];
      const most = level ? pyramid.high[level - 1][at] : pyramid.values[at];
      if (least < low) low = least;
      if (most > high) high = most;
      row += 1 << bits;
    }
    out[0] = low;
    out[1] = high;
  }

  /** Gaps before rows in (begin, end). @param {number} begin @param {number} end */
  gapsWithin(begin, end) {
    return this.gaps.filter((gap) => gap.row > begin && gap.row < end);
  }

  /**
   * The rows from `begin` to `end` in about `buckets` buckets that never reach across a gap of `wideS` or more. A narrower
   * one is less than a pixel: it is marked above the curve, and cutting the curve there would be seen by nobody.
   * @param {number} begin @param {number} end @param {number} buckets @param {number} wideS
   * @returns {{starts: number[], ends: number[]}} −1 stands for a gap
   */
  buckets(begin, end, buckets, wideS) {
    const starts = [];
    const ends = [];
    let size = Math.max(1, Math.ceil((end - begin) / buckets));
    if (size > 16) {
      // whole blocks of the largest level that fits make every bucket a few look-ups
      const block = 16 ** Math.floor(Math.log2(size) / FACTOR_BITS);
      size = Math.ceil(size / block) * block;
    }
    const wide = (/** @type {Gap} */ { row }) => this.timeAt(row) - this.timeAt(row - 1) >= wideS;
    const stops = this.gapsWithin(begin, end).filter(wide).map((gap) => gap.row);
    stops.push(end);
    let row = begin;
    for (const stop of stops) {
      while (row < stop) {
        const next = Math.min(stop, (Math.floor(row / size) + 1) * size);
        starts.push(row);
        ends.push(next);
        row = next;
      }
      if (stop < end) {
        starts.push(-1);
        ends.push(-1);
      }
    }
    return { starts, ends };
  }

  /**
   * Lay a simulated release over the rows from `start`: by tick, so that a missed period moves nothing.
   * @param {number} start row of the release's first rendered tick
   * @param {Float32Array} model position in coarse ticks, tick by tick
   */
  overlay(start, model) {
    const { mask } = this;
    const zero = this.tick[start & mask];
    let row = start;
    for (; row < this.head; row++) {
      const k = this.tick[row & mask] - zero;
      if (k < 0 || k >= model.length) break;
      this.channels.model.values[row & mask] = model[k];
      this.channels.residual.values[row & mask] = this.channels.position.values[row & mask] - model[k];
    }
    // whole blocks around the changed rows
    this.build("model", start, row + 65536 > this.head ? this.head : row + 65536);
    this.build("residual", start, row + 65536 > this.head ? this.head : row + 65536);
    this.derive(start, this.head);
    return row;
  }

  /** Rows from `begin` to `end` in a store of their own, which nothing overwrites. @param {number} begin @param {number} end */
  copy(begin, end) {
    const rows = end - begin;
    const store = new Store(Math.max(SMALLEST, 2 ** Math.ceil(Math.log2(Math.max(rows, 1)))));
    const { mask } = this;
    for (let i = 0; i < rows; i++) {
      const at = (begin + i) & mask;
      store.time[i] = this.time[at];
      store.tick[i] = this.tick[at];
      store.counts[i] = this.counts[at];
      store.flags[i] = this.flags[at];
      store.epochs[i] = this.epochs[at];
      for (const name of RECORDED) store.channels[name].values[i] = this.channels[name].values[at];
    }
    const { decimation, rawResolution, originCounts, periodS, lost, missed } = this;
    Object.assign(store, { decimation, rawResolution, originCounts, periodS, lost, missed, head: rows });
    store.gaps = this.gapsWithin(begin, end).map((gap) => ({ ...gap, row: gap.row - begin }));
    for (const name of RECORDED) store.build(name, 0, rows);
    return store;
  }

  /** Rows from `begin` to `end` as one frame of the server's format, as often as it takes. @param {number} begin @param {number} end */
  frames(begin, end) {
    const parts = [];
    const { mask } = this;
    for (let from = begin; from < end; from += 4096) {
      const rows = Math.min(4096, end - from);
      const buffer = new ArrayBuffer(4 + 64 + 36 * rows);
      const view = new DataView(buffer);
      view.setUint32(0, 64 + 36 * rows, true);
      view.setUint32(4, 0x31465348, true);
      view.setUint32(8, rows, true);
      view.setBigInt64(12, BigInt(from), true);
      view.setBigInt64(20, BigInt(this.tick[from & mask]), true);
      view.setUint32(32, this.decimation, true);
      view.setFloat64(36, this.time[from & mask], true);
      view.setFloat64(44, this.periodS, true);
      view.setBigInt64(60, BigInt(this.originCounts), true);
      for (let i = 0; i < rows; i++) {
        const at = (from + i) & mask;
        const put = (/** @type {number} */ column) => 68 + 4 * (rows * column + i);
        view.setInt32(put(0), this.tick[at] - this.tick[from & mask], true);
        view.setFloat32(put(1), this.time[at] - this.time[from & mask], true);
        view.setInt32(put(2), this.counts[at], true);
        view.setInt32(put(3), this.channels.coarse.values[at], true);
        view.setFloat32(put(4), this.channels.current.values[at], true);
        view.setFloat32(put(5), this.channels.measured.values[at], true);
        view.setFloat32(put(6), this.channels.force.values[at], true);
        view.setFloat32(put(7), this.channels.late.values[at], true);
        view.setInt32(put(8), this.flags[at], true);
      }
      parts.push(buffer);
    }
    return parts;
  }
}
