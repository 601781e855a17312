// The capture: every row that comes goes into the live source's ring, whatever is looked at. Rows that come before the config
// wait for it, because without its scales nothing can be told of them.
// @ts-check

import { FLAG, decode } from "./frames.js";
import { describe } from "./source.js";

/** Frames: forty seconds. */
const MOST_WAITING = 512;

export class Capture {
  /** @param {import("./source.js").Source} live @param {(row: number) => void} fault a fault began in this row */
  constructor(live, fault) {
    this.live = live;
    this.fault = fault;
    /** @type {import("./frames.js").Frame[]} */ this.waiting = [];
    this.newestUnixS = NaN;
    this.clockOffsetS = Infinity;
  }

  /** How much later than the server's our clock is, with the shortest way seen: the best that can be known. @param {number} unixS */
  heard(unixS) {
    this.clockOffsetS = Math.min(this.clockOffsetS, Date.now() / 1000 - unixS);
  }

  /** Age of the newest row, s. By the wall clock, which goes on while a computer sleeps. */
  get age() {
    return Date.now() / 1000 - this.clockOffsetS - this.newestUnixS;
  }

  /** @param {ArrayBuffer} data */
  rows(data) {
    const found = decode(data);
    this.heard(found.unixS);
    if (!found.rows) return;
    this.newestUnixS = found.unixS;
    if (this.live.config) this.append(found);
    else if (this.waiting.push(found) > MOST_WAITING) this.waiting.shift();
  }

  /** @param {any} message */
  config(message) {
    describe(this.live, message);
    for (const frame of this.waiting.splice(0)) this.append(frame);
  }

  /** @param {import("./frames.js").Frame} frame */
  append(frame) {
    const { store } = this.live;
    const before = store.head;
    store.append(frame);
    for (let row = Math.max(before, 1); row < store.head; row++) {
      if (store.flags[row & store.mask] & ~store.flags[(row - 1) & store.mask] & FLAG.fault) this.fault(row);
    }
  }
}
