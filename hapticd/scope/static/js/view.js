// The view: which rows are seen, of which source, rolling or held. It only looks. Whether it rolls, is held, scrolls back
// or shows a file, the capture goes on and loses nothing.
// @ts-check

import { byId, duration, make, say } from "./dom.js";

const WINDOWS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];
const LONGEST_S = 60;
const AFTER_FAULT_S = 0.3;
const BEFORE_FAULT_S = 3;
const ROLL_BEHIND_S = 0.25;
/** So many rows before the ring would overwrite the oldest one of a held picture, it is put aside. */
const KEEP_ROWS = 1 << 14;

/** @typedef {import("./source.js").Source} Source */

export class View {
  /** @param {Source} live @param {import("./trigger.js").Trigger} trigger */
  constructor(live, trigger) {
    this.live = live;
    this.trigger = trigger;
    this.source = live;
    /** @type {import("./trace.js").Trace} */ this.trace = /** @type {any} */ (null);
    this.windowS = 2;
    this.held = false;
    /** Left edge while held, and the time that is called 0 then. */
    this.from = -1;
    this.zero = 0;
    this.faultRow = -1;
    this.rolled = 0;
    this.rolledAt = 0;
    /** Called with another source. @type {() => void} */ this.changed = () => {};
    const select = byId("window", HTMLSelectElement);
    select.append(...WINDOWS.map((value) => make("option", { value: String(value) }, duration(value))), make("option", { value: "", hidden: "" }, ""));
    select.addEventListener("change", () => {
      if (select.value) this.windowS = Number(select.value);
      this.tellWindow();
    });
    byId("run").addEventListener("click", () => this.hold(!this.held));
    byId("back").addEventListener("click", () => this.roll());
    this.tellWindow();
  }

  get store() {
    return this.source.store;
  }

  /** Whether the rows are the live ones, rolling or put aside. */
  get isLive() {
    return !this.source.name;
  }

  newest() {
    return this.store.head ? this.store.timeAt(this.store.head - 1) : 0;
  }

  /** Left edge: where it is held, drawn yet or not; else as it was drawn last. */
  get left() {
    return this.held ? this.from : this.trace.view[0] + this.trace.zero;
  }

  /** The rows in view. */
  rows() {
    const right = this.held ? this.from + this.windowS : this.trace.view[1] + this.trace.zero;
    return { begin: this.store.rowAt(this.left), end: this.store.rowAt(right) };
  }

  /** Look at the present. */
  roll() {
    this.look(this.live);
    this.hold(false);
  }

  /** @param {boolean} held @param {string} [why] */
  hold(held, why = "") {
    this.held = held;
    if (held) {
      this.from = this.trace.view[0] + this.trace.zero;
      this.zero = this.trace.zero;
    } else {
      this.look(this.live);
      this.trigger.reset(this.store.head);
      this.faultRow = -1;
    }
    byId("run").textContent = held ? "Run" : "Hold";
    byId("run").setAttribute("aria-pressed", String(held));
    say("hold-why", held ? why || "held: scroll with the mouse; the capture goes on" : "");
  }

  /** Hold a picture. @param {number} from @param {number} windowS @param {number} zero the time that is called 0 @param {string} why */
  show(from, windowS, zero, why) {
    this.windowS = windowS;
    this.trace.triggerTime = zero;
    this.trace.zero = zero;
    this.trace.view = [from - zero, from + windowS - zero];
    this.hold(true, why);
    this.tellWindow();
  }

  /** @param {Source} source */
  look(source) {
    if (this.source === source) return;
    this.source = source;
    this.trace.triggerTime = NaN;
    Object.assign(this.trace.cursors, { a: NaN, b: NaN });
    byId("file").hidden = this.isLive;
    this.trace.rebuild();
    this.changed();
  }

  /** @param {number} factor @param {number} at */
  zoom(factor, at) {
    const wide = Math.min(LONGEST_S, Math.max(20 * this.store.periodS, this.windowS * factor));
    if (this.held) this.from = at - ((at - this.from) * wide) / this.windowS;
    this.windowS = wide;
    this.tellWindow();
  }

  /** @param {number} by */
  pan(by) {
    if (!this.held) this.hold(true);
    const oldest = this.store.head ? this.store.timeAt(this.store.first) - this.windowS / 2 : 0;
    this.from = Math.min(this.newest() - this.windowS / 10, Math.max(oldest, this.from + by));
  }

  tellWindow() {
    const select = byId("window", HTMLSelectElement);
    const known = WINDOWS.find((value) => Math.abs(value / this.windowS - 1) < 1e-6);
    select.value = known ? String(known) : "";
    const other = select.querySelector("option[value='']");
    if (other) other.textContent = duration(this.windowS);
  }

  /** Where a rolling trace ends: from one message to the next it moves on with the clock, and never beyond the newest row. */
  rolling() {
    const now = performance.now() / 1000;
    const behind = this.newest() - this.rolled - (now - this.rolledAt);
    this.rolled = this.newest() - (behind > 0 && behind < ROLL_BEHIND_S ? behind : 0);
    this.rolledAt = now;
    return this.rolled;
  }

  /** Which time span is seen now, and which time is called 0. @returns {[number, number, number]} */
  span() {
    const { trigger, trace, windowS } = this;
    if (this.held) return [this.from, this.from + windowS, this.zero];
    const { mode, pre } = trigger.settings;
    const end = this.rolling();
    if (mode !== "roll" && trigger.at >= this.store.first && trigger.at >= 0) {
      const time = this.store.timeAt(trigger.at);
      const stale = mode === "auto" && end - time > Math.max(2 * windowS, 0.5);
      if (!stale) {
        trace.triggerTime = time;
        return [time - windowS * pre, time + windowS * (1 - pre), time];
      }
    }
    trace.triggerTime = NaN;
    return [end - windowS, end, end];
  }

  /** Draw one frame; how many rows it shows. */
  frame() {
    const { trigger, trace, store } = this;
    if (!this.held && trigger.settings.mode !== "roll") {
      trigger.look(store, this.windowS);
      if (trigger.settings.mode === "single" && trigger.full(store, this.windowS)) {
        const time = store.timeAt(trigger.at);
        this.show(time - this.windowS * trigger.settings.pre, this.windowS, time, "single shot taken");
      }
    }
    if (this.faultRow >= 0 && !this.held && this.newest() >= store.timeAt(this.faultRow) + AFTER_FAULT_S) this.freeze();
    if (this.held) this.keep();
    const [left, right, zero] = this.span();
    trace.marks = this.source.marks;
    const { begin, end } = trace.draw(this.store, left, right, zero);
    return end - begin;
  }

  /** The seconds before a fault stay on the screen. */
  freeze() {
    const time = this.store.timeAt(this.faultRow);
    const wide = Math.max(this.windowS, BEFORE_FAULT_S);
    this.show(time + AFTER_FAULT_S - wide, wide, time, "frozen by the fault at 0 s; Run looks at the present again");
  }

  /** A held picture of live rows that the ring is about to overwrite is put aside. */
  keep() {
    const { store } = this;
    if (store !== this.live.store || store.head + KEEP_ROWS <= store.capacity) return;
    const begin = Math.max(store.first, store.rowAt(this.from) - 1);
    if (begin > store.head + KEEP_ROWS - store.capacity) return;
    const end = Math.min(store.head, store.rowAt(this.from + this.windowS) + 1);
    this.source = { ...this.live, store: store.copy(begin, end) };
    say("hold-why", `${byId("hold-why").textContent}; put aside, for the ring has gone on`);
  }
}
