// The release experiment: asked for, waited for, and laid over the exact simulation of the deflection that was achieved.
// @ts-check

import { bringAbout } from "./commands.js";
import { byId, duration, number, say } from "./dom.js";
import { FLAG, decodeStream, prefixed } from "./frames.js";
import { ask, request } from "./link.js";
import { refuseAt } from "./quantity.js";
import { showRefusal } from "./refusal.js";

/** @typedef {import("./quantity.js").Field} Field */

/** @typedef {{deflection: number, durationS: number, experiment: number, from: number, start: number, model: Float32Array | null, overTick: number, over: boolean, simulated: Promise<void>, missed: number, firstMissedS: number, replayed: boolean}} Running */

/** As a person would say it. @param {import("./quantity.js").Quantity} quantity */
const named = ({ text, unit }) => (/[a-z°]\s*$/i.test(text) ? text.trim() : `${text.trim()} ${unit}`);

export class Release {
  /**
   * @param {import("./view.js").View} view
   * @param {Record<"deflection" | "duration_s", Field>} fields
   * @param {(begin: number, end: number) => void} ended a release is over whose rows these are
   */
  constructor(view, fields, ended) {
    this.view = view;
    this.fields = fields;
    this.ended = ended;
    /** @type {Running | null} */ this.running = null;
    byId("release-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.begin();
    });
    // what was refused is not what would be asked for now
    byId("release-form").addEventListener("input", () => say("release-answer", ""));
  }

  get store() {
    return this.view.live.store;
  }

  /** As typed. */
  async begin() {
    const { fields } = this;
    for (const field of Object.values(fields)) field.refuse("");
    const asked = { deflection: fields.deflection.said(), duration_s: fields.duration_s.said() };
    try {
      await this.send(asked, false);
    } catch (error) {
      say("release-answer", "");
      if (refuseAt(error, fields)) return;
      showRefusal(byId("release-answer"), error, {
        what: `a release from ${named(asked.deflection)} for ${named(asked.duration_s)}`,
        apply: (remedy) => this.apply(remedy),
        force: () => this.send(asked, true),
      });
    }
  }

  /** Bring a remedy about: the release waits for its button. @param {import("./refusal.js").Remedy} remedy */
  async apply(remedy) {
    if (remedy.key === "deflection") this.fields.deflection.propose(`${remedy.after}${remedy.unit}`);
    else await bringAbout(remedy);
    say("release-answer", `${remedy.key} is ${remedy.after} ${remedy.unit}; Release tries again`);
  }

  /** @param {Record<string, import("./quantity.js").Quantity>} asked @param {boolean} force */
  async send(asked, force) {
    say("release-answer", "waiting for the shaft to rest …");
    say("release-outcome", "");
    say("release-residual", "");
    this.view.roll();
    const from = this.store.head;
    const reply = await ask("release", { ...asked, force });
    for (const field of Object.values(this.fields)) field.settle(field.input.value);
    say("release-answer", `released from ${number(reply.achieved_deflection)} ticks, exact to one raw count`);
    this.running = { deflection: reply.achieved_deflection, durationS: reply.duration_s, experiment: reply.experiment, from, start: -1, model: null, overTick: NaN, over: false, simulated: Promise.resolve(), missed: 0, firstMissedS: NaN, replayed: false };
    this.running.simulated = this.simulate(this.running);
  }

  /** Whether the simulation of a release in these rows is not back yet. @param {import("./store.js").Store} store @param {number} begin @param {number} end */
  isAwaited(store, begin, end) {
    const { running } = this;
    return Boolean(running && store === this.store && !running.model && running.start < end && running.start + running.durationS / store.periodS > begin);
  }

  /** What in the residual is no physics: the simulation kept every period, the loop did not. */
  get note() {
    const { missed, firstMissedS, replayed } = this.running ?? { missed: 0, firstMissedS: NaN, replayed: false };
    if (!missed) return "";
    if (replayed) return `${missed} period${missed > 1 ? "s" : ""} missed: the simulation ticks when the loop did`;
    return `${missed} period${missed > 1 ? "s" : ""} missed, which the simulation kept: from ${duration(firstMissedS)} on it is of the timing, too`;
  }

  /** Why there is no residual. */
  why() {
    if (!this.running) return "no release yet: the residual is measured less simulated";
    return this.running.model ? "no rows of the release in this window" : "the simulation of this release is not back yet";
  }

  /** @param {Running} running */
  async simulate(running) {
    try {
      const reply = await request("simulate", { deflection: running.deflection, duration_s: running.durationS });
      this.take(running, await reply.arrayBuffer());
    } catch (error) {
      say("release-answer", `no simulation: ${error instanceof Error ? error.message : String(error)}`);
    }
  }

  /** Once more with the ticks as they were, where the loop has missed some of them and all that it did are here. @param {Running} running */
  async replay(running) {
    const { store } = this;
    const { config } = this.view.live;
    let end = running.start;
    while (end < store.head && store.flags[end & store.mask] & FLAG.running && !(store.flags[end & store.mask] & FLAG.dropped)) end++;
    if (store.gapsWithin(running.start, end).some((gap) => gap.kind !== "missed")) return;
    const description = new TextEncoder().encode(JSON.stringify({ config, deflection: running.deflection }));
    try {
      const reply = await request("replay", new Blob([...prefixed(description), ...store.frames(running.start, end)]), { type: "application/vnd.hapticd.frames" });
      this.take(running, await reply.arrayBuffer(), true);
    } catch {
      // the simulation that kept every period stays, and the note says so
    }
  }

  /** Places of the simulation, by tick. @param {Running} running @param {ArrayBuffer} stream @param {boolean} [replayed] */
  take(running, stream, replayed = false) {
    const { description, frames } = decodeStream(stream);
    const last = frames[frames.length - 1];
    const model = new Float32Array(last ? last.firstTick + last.tickOffset[last.rows - 1] - frames[0].firstTick + 1 : 0).fill(NaN);
    for (const frame of frames) for (let i = 0; i < frame.rows; i++) model[frame.firstTick - frames[0].firstTick + frame.tickOffset[i]] = frame.counts[i] / frame.decimation;
    Object.assign(running, { model, replayed });
    byId("release-outcome").dataset.simulated = String(description.report.outcome);
    this.lay(running);
  }

  /** Look for the first rendered row, and for the end. @param {any} status */
  look(status) {
    const { running } = this;
    if (!running) return;
    const { store } = this;
    if (running.start < 0) {
      const { flags, mask } = store;
      for (let row = Math.max(running.from, store.first); row < store.head; row++) {
        if (flags[row & mask] & FLAG.running) {
          // Its first tick is the one after a row at rest; if that row did not come, nobody knows which tick this is.
          const whole = row > store.first && store.tick[row & mask] === store.tick[(row - 1) & mask] + 1;
          if (whole) running.start = row;
          else say("release-answer", "the first ticks of the release did not come here: there is no simulation to compare");
          break;
        }
      }
    }
    const { experiment } = status;
    if (running.over || !experiment || experiment.id !== running.experiment || experiment.state === "running") return;
    // its last rows may come after this: over another connection
    const { ticks, missed } = status.timing;
    if (Number.isNaN(running.overTick)) running.overTick = ticks + missed;
    if (store.head && store.tick[(store.head - 1) & store.mask] < running.overTick) return;
    running.over = true;
    const result = experiment.result ?? {};
    const words = /** @type {Record<string, string>} */ ({
      decaying: "decaying: it came or comes to rest",
      persistent: "persistent: it goes on oscillating",
      growing: "growing: it ran away",
      monotone: "monotone: its energy never rose",
    });
    const fault = result.fault ? `, ended by the fault ${result.fault}` : "";
    say("release-outcome", result.outcome ? `${words[result.outcome] ?? result.outcome}${fault}` : `${experiment.state}${fault}`);
    byId("release-outcome").dataset.outcome = String(result.outcome);
    this.lay(running);
    this.show(running);
    if (running.missed && running.start >= store.first) running.simulated = running.simulated.then(() => this.replay(running));
  }

  /** The whole release, as a single shot, unless something else is looked at. @param {Running} running */
  show(running) {
    const { store, view } = this;
    if (running.start < store.first) return;
    const start = store.timeAt(running.start);
    const lasted = Math.max(0.05, Math.min(running.durationS, store.timeAt(store.head - 1) - start));
    this.ended(running.start, store.rowAt(start + lasted));
    if (view.store !== store) return;
    view.show(start - 0.05 * lasted, 1.1 * lasted, start, "the release, taken as a single shot; Run looks at the present again");
  }

  /** @param {Running} running */
  lay(running) {
    const { store } = this;
    if (running.start < store.first) return;
    this.countMissed(running);
    if (!running.model) return;
    const end = store.overlay(running.start, running.model);
    let squares = 0;
    let count = 0;
    for (let row = running.start; row < end; row++) {
      const value = store.value("residual", row);
      squares += value * value;
      count++;
    }
    if (!running.over || !count) return;
    const simulated = byId("release-outcome").dataset.simulated;
    say("release-residual", `residual ${number(Math.sqrt(squares / count), 3)} ticks RMS over ${count} ticks; the simulation is ${simulated}${this.note ? `; ${this.note}` : ""}`);
  }

  /** Periods that the loop has missed in the release. @param {Running} running */
  countMissed(running) {
    const { store } = this;
    const end = store.rowAt(store.timeAt(running.start) + running.durationS);
    const missed = store.gapsWithin(running.start, end).filter((gap) => gap.kind === "missed");
    running.missed = missed.reduce((sum, gap) => sum + gap.ticks, 0);
    running.firstMissedS = missed.length ? store.timeAt(missed[0].row - 1) - store.timeAt(running.start) : NaN;
  }
}
