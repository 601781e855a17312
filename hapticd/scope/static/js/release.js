// The release experiment: asked for, waited for, and laid over the exact simulation of the deflection that was achieved.
// @ts-check

import { byId, number, say } from "./dom.js";
import { FLAG, decodeStream } from "./frames.js";
import { ask, request } from "./link.js";
import { refuseAt } from "./quantity.js";
import { showRefusal } from "./refusal.js";

/** @typedef {import("./quantity.js").Field} Field */

/** @typedef {{deflection: number, durationS: number, experiment: number, from: number, start: number, model: Float32Array | null, over: boolean}} Running */

/** As a person would say it. @param {import("./quantity.js").Quantity} quantity */
const named = ({ text, unit }) => (/[a-z°]\s*$/i.test(text) ? text.trim() : `${text.trim()} ${unit}`);

export class Release {
  /**
   * @param {() => import("./store.js").Store} store
   * @param {() => void} prepare called before anything moves: from here on every row is needed
   * @param {(running: Running) => void} ended with the rows' place known and the simulation, if it could be had, laid over
   */
  constructor(store, prepare, ended) {
    this.store = store;
    this.prepare = prepare;
    this.ended = ended;
    /** @type {Running | null} */ this.running = null;
  }

  /** As typed. @param {Record<"deflection" | "duration_s", Field>} fields */
  async begin(fields) {
    const { deflection, duration_s } = fields;
    for (const field of Object.values(fields)) field.refuse("");
    const asked = { deflection: deflection.said(), duration_s: duration_s.said() };
    try {
      await this.send(asked, fields, false);
    } catch (error) {
      say("release-answer", "");
      if (refuseAt(error, fields)) return;
      showRefusal(byId("release-answer"), error, {
        what: `a release from ${named(asked.deflection)} for ${named(asked.duration_s)}`,
        apply: (remedy) => this.apply(remedy, deflection),
        force: () => this.send(asked, fields, true),
      });
    }
  }

  /** Bring a remedy about: the release waits for its button. @param {import("./refusal.js").Remedy} remedy @param {Field} deflection */
  async apply(remedy, deflection) {
    if (remedy.key === "deflection") deflection.propose(`${remedy.after}${remedy.unit}`);
    else if (remedy.key === "spring.origin") await ask("origin", { force: false });
    else await ask("set", { settings: { [remedy.key]: remedy.after }, force: false });
    say("release-answer", `${remedy.key} is ${remedy.after} ${remedy.unit}; Release tries again`);
  }

  /** @param {Record<string, import("./quantity.js").Quantity>} asked @param {Record<string, Field>} fields @param {boolean} force */
  async send(asked, fields, force) {
    say("release-answer", "waiting for the shaft to rest …");
    say("release-outcome", "");
    this.prepare();
    const from = this.store().head;
    const reply = await ask("release", { ...asked, force });
    for (const field of Object.values(fields)) field.settle(field.input.value);
    say("release-answer", `released from ${number(reply.achieved_deflection)} ticks, exact to one raw count`);
    this.running = { deflection: reply.achieved_deflection, durationS: reply.duration_s, experiment: reply.experiment, from, start: -1, model: null, over: false };
    this.simulate(this.running);
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
      const { description, frames } = decodeStream(await reply.arrayBuffer());
      const model = new Float32Array(frames.reduce((sum, frame) => sum + frame.rows, 0));
      let at = 0;
      for (const frame of frames) for (let i = 0; i < frame.rows; i++) model[at++] = frame.counts[i] / frame.decimation;
      running.model = model;
      byId("release-outcome").dataset.simulated = String(description.report.outcome);
      this.lay(running);
    } catch (error) {
      say("release-answer", `no simulation: ${error instanceof Error ? error.message : String(error)}`);
    }
  }

  /** Look for the first rendered row, and for the end. @param {any} status */
  look(status) {
    const { running } = this;
    if (!running) return;
    const store = this.store();
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
    this.ended(running);
  }

  /** @param {Running} running */
  lay(running) {
    const store = this.store();
    if (running.start < store.first || !running.model) return;
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
    say("release-residual", `residual ${number(Math.sqrt(squares / count), 3)} ticks RMS over ${count} ticks; the simulation is ${simulated}`);
  }
}
