// A sequence: a list of settings with one release each, played by the daemon as one experiment.
// @ts-check

import { bringAbout, command } from "./commands.js";
import { byId, make, number, say } from "./dom.js";

export class Sequence {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    /** Number of the experiment that this page has begun. */
    this.experiment = -1;
    this.told = "";
    // what was refused is not what would be asked for now
    byId("sequence-text").addEventListener("input", () => say("sequence-answer", ""));
    byId("sequence-form").addEventListener("submit", (event) => {
      event.preventDefault();
      view.roll();
      say("sequence-answer", "waiting for the shaft to rest …");
      byId("sequence-runs").replaceChildren();
      const field = byId("sequence-text", HTMLTextAreaElement);
      const begun = (/** @type {any} */ answer) => {
        this.experiment = answer.experiment;
        this.told = "";
        say("sequence-answer", `${answer.steps} releases; the first is recorded to ${answer.run}`);
      };
      const apply = (/** @type {import("./refusal.js").Remedy} */ remedy) => (remedy.text ? (field.value = remedy.text) : bringAbout(remedy));
      command("sequence", { text: field.value, force: false }, "sequence-answer", begun, () => false, apply);
    });
  }

  /** What has come of it so far. @param {any} experiment as the daemon reports it */
  look(experiment) {
    if (!experiment || experiment.id !== this.experiment) return;
    const { runs, fault, error } = experiment.result;
    const told = `${experiment.state} ${runs.length}`;
    if (told === this.told) return;
    this.told = told;
    byId("sequence-runs").replaceChildren(...runs.map((/** @type {any} */ run) => make("li", {}, describe(run))));
    if (experiment.state === "running") return say("sequence-answer", `release ${experiment.step} of ${experiment.steps}`);
    const why = fault ? `, ended by the fault ${fault}` : error ? `: ${error}` : "";
    say("sequence-answer", `${experiment.state}: ${runs.length} of ${experiment.steps} releases${why}`);
  }
}

/** @param {{settings: Record<string, unknown>, achieved_deflection: number, held_by_friction: boolean, outcome: string | null}} run */
function describe({ settings, achieved_deflection, held_by_friction, outcome }) {
  const changed = Object.entries(settings).map(([key, value]) => `${key} = ${value}`);
  return [`${number(achieved_deflection)} ticks`, ...changed, held_by_friction ? "held by friction" : (outcome ?? "no outcome")].join(", ");
}
