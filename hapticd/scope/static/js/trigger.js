// The trigger: looks at every row as it comes, of any channel, shown or not.
// @ts-check

import { FLAG } from "./frames.js";

/**
 * @typedef {object} TriggerSettings
 * @property {"roll" | "auto" | "normal" | "single"} mode
 * @property {"rising" | "falling" | "fault" | "settings" | "release"} on
 * @property {import("./store.js").Channel} channel
 * @property {number} level
 * @property {number} hysteresis
 * @property {number} holdoffS
 * @property {number} pre fraction of the window before the trigger
 */

export class Trigger {
  constructor() {
    /** @type {TriggerSettings} */
    this.settings = { mode: "roll", on: "rising", channel: "position", level: 0, hysteresis: 0.5, holdoffS: 0, pre: 0.2 };
    this.next = 0;
    this.armed = false;
    /** The newest trigger's row, −1 while there is none. */
    this.at = -1;
    this.quietUntil = -Infinity;
  }

  /** Forget everything before this row, and wait anew. @param {number} row */
  reset(row) {
    this.next = row;
    this.armed = false;
    this.at = -1;
    this.quietUntil = -Infinity;
  }

  /**
   * Look at the rows that have come; stops behind a trigger whose window is not full yet.
   * @param {import("./store.js").Store} store
   * @param {number} windowS
   */
  look(store, windowS) {
    const { settings } = this;
    const values = store.channels[settings.channel].values;
    this.next = Math.max(this.next, store.first + 1);
    for (; this.next < store.head; this.next++) {
      const row = this.next;
      const at = row & store.mask;
      if (!this.fires(store, values[at], row)) continue;
      const time = store.time[at];
      if (time < this.quietUntil) continue;
      if (settings.mode === "single" && this.at >= 0) continue;
      this.at = row;
      // the next one not before this window is full, so that what is shown is one whole window
      this.quietUntil = time + Math.max(settings.holdoffS, windowS * (1 - settings.pre));
    }
  }

  /** @param {import("./store.js").Store} store @param {number} value @param {number} row */
  fires(store, value, row) {
    const { on, level, hysteresis } = this.settings;
    const at = row & store.mask;
    const before = (row - 1) & store.mask;
    if (on === "fault") return Boolean(store.flags[at] & FLAG.fault & ~store.flags[before]);
    if (on === "release") return Boolean(store.flags[at] & FLAG.running & ~store.flags[before]);
    if (on === "settings") return store.epochs[at] !== store.epochs[before];
    const up = on === "rising" ? 1 : -1;
    if (up * (value - level) < -hysteresis) this.armed = true;
    if (!this.armed || !(up * (value - level) >= 0)) return false;
    this.armed = false;
    return true;
  }

  /**
   * What it does: nothing; waits for an edge's other side, without which it cannot fire; armed; has fired, and its window
   * or its hold-off is not over.
   * @param {import("./store.js").Store} store @returns {"off" | "waiting" | "armed" | "fired"}
   */
  state(store) {
    const { mode, on } = this.settings;
    if (mode === "roll") return "off";
    if (this.at >= 0 && (mode === "single" || !store.head || store.timeAt(store.head - 1) < this.quietUntil)) return "fired";
    return this.armed || !(on === "rising" || on === "falling") ? "armed" : "waiting";
  }

  /** Whether the newest trigger's window is full. @param {import("./store.js").Store} store @param {number} windowS */
  full(store, windowS) {
    return this.at >= 0 && store.head > 0 && store.timeAt(store.head - 1) >= this.end(store, windowS);
  }

  /** Where the newest trigger's window ends. @param {import("./store.js").Store} store @param {number} windowS */
  end(store, windowS) {
    return store.timeAt(this.at) + windowS * (1 - this.settings.pre);
  }
}
