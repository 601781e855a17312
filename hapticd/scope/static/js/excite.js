// Excitations, with amplitude, duration and frequencies: what the daemon would choose stands in the fields from the start.
// @ts-check

import { command } from "./commands.js";
import { byId, duration, make, number, say } from "./dom.js";
import { Field, refuseAt } from "./quantity.js";

/** @typedef {"amplitude" | "duration_s" | "low_hz" | "high_hz"} Key */
/** @typedef {{name: string, summary: string, plan: Partial<Record<Key, {value: number, unit: string}>>}} Shape */

const NUMBERS = /** @type {const} */ (["amplitude", "duration_s", "low_hz", "high_hz"]);

export class Excite {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    this.view = view;
    /** @type {Shape[]} */ this.shapes = [];
    this.select = byId("excite-name", HTMLSelectElement);
    /** @type {Record<string, Field>} */ this.fields = {};
    for (const name of NUMBERS) {
      this.fields[name] = new Field(byId(`excite-${name}`, HTMLInputElement), () => this.shape?.plan[name]?.unit ?? "", null, byId(`excite-${name}-refusal`));
    }
    this.select.addEventListener("change", () => this.choose());
    byId("excite-form").addEventListener("input", () => say("excite-answer", ""));
    byId("excite-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.begin();
    });
  }

  get shape() {
    return this.shapes.find(({ name }) => name === this.select.value);
  }

  /** What can be played with the config in force. @param {Shape[]} shapes */
  configured(shapes) {
    const chosen = this.select.value;
    this.shapes = shapes;
    if (!this.select.options.length) this.select.append(...shapes.map(({ name }) => make("option", { value: name }, name)));
    if (chosen) for (const name of NUMBERS) this.settle(name);
    else this.choose();
  }

  /** Another shape: its own numbers. */
  choose() {
    say("excite-summary", this.shape?.summary ?? "");
    for (const name of NUMBERS) {
      this.fields[name].withdraw();
      this.fields[name].refuse("");
      this.settle(name);
    }
  }

  /** @param {Key} name */
  settle(name) {
    const found = this.shape?.plan[name];
    const label = byId(`excite-for-${name}`);
    label.hidden = !found;
    if (!found) return;
    /** @type {HTMLElement} */ (label.querySelector(".unit")).textContent = found.unit;
    this.fields[name].settle(number(found.value, 3));
  }

  begin() {
    const { shape } = this;
    if (!shape) return;
    this.view.roll();
    // what nobody has changed is the daemon's own choice, to its last digit
    const typed = NUMBERS.filter((name) => shape.plan[name] && this.fields[name].input.value !== this.fields[name].settled);
    const plan = Object.fromEntries(typed.map((name) => [name, this.fields[name].said()]));
    for (const name of NUMBERS) this.fields[name].refuse("");
    command(
      "excite",
      { name: shape.name, plan, force: false },
      "excite-answer",
      (answer) => say("excite-answer", `${duration(answer.duration_s)}, recorded to ${answer.run}`),
      (error) => refuseAt(error, this.fields),
    );
  }
}
