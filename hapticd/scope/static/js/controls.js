// Live settings: sent when a slider is let go, shown as the daemon confirmed them, refused in its own words beside the
// control they belong to. While one is dragged, the plane shows where it would land.
// @ts-check

import { byId, lookUp, make, number } from "./dom.js";
import { ask } from "./link.js";
import { Field } from "./quantity.js";
import { showRefusal } from "./refusal.js";

const PREVIEW_MS = 60;
const STEPS = 1000;

/**
 * @typedef {object} Setting
 * @property {string} key
 * @property {string} label
 * @property {string} [unit]
 * @property {string} [linearUnit]
 * @property {[number, number]} [range]
 * @property {[number, number]} [linearRange]
 * @property {boolean} [log]
 * @property {boolean} [zero] the slider's lower end is 0, whatever the range
 * @property {boolean} [whole]
 * @property {number} [factor] shown = value · factor
 * @property {string[]} [choices]
 * @property {string} [none] what 0 or null stands for; such a setting is typed, and has no slider
 */

/** @type {Setting[]} */
const SETTINGS = [
  { key: "spring.stiffness", label: "Stiffness K", unit: "N m/rad", linearUnit: "N/m", range: [1e-4, 10], linearRange: [1, 1e5], log: true },
  { key: "spring.damping", label: "Damping B", unit: "N m s/rad", linearUnit: "N s/m", range: [1e-7, 1e-2], linearRange: [1e-3, 1e3], log: true, zero: true },
  { key: "encoder.decimation", label: "Decimation N", unit: "counts/tick", range: [1, 1024], log: true, whole: true },
  { key: "servo.rate_hz", label: "Servo rate 1/T", unit: "Hz", range: [50, 20000], log: true, whole: true },
  { key: "delay.computation_s", label: "Delay T_V", unit: "ms", range: [0, 10], factor: 1e3 },
  { key: "dither.target", label: "Dither", choices: ["none", "position", "current"] },
  { key: "dither.waveform", label: "Dither form", choices: ["sine", "triangle", "square", "uniform"] },
  { key: "dither.amplitude", label: "Dither amplitude", unit: "ticks", range: [0, 2] },
  { key: "dither.frequency_hz", label: "Dither frequency", unit: "Hz", range: [0, 500] },
  { key: "spring.side", label: "Wall", choices: ["both", "positive", "negative"] },
];

/** What trips the loop, and what is refused. @type {Setting[]} */
const LIMITS = [
  { key: "safety.max_velocity", label: "Largest speed", unit: "rad/s", linearUnit: "m/s", none: "no limit" },
  { key: "safety.max_excursion", label: "Largest distance", unit: "rad", linearUnit: "m", none: "no limit" },
  { key: "safety.encoder_jump", label: "Largest jump", unit: "counts", none: "no limit" },
  { key: "safety.current_mismatch", label: "Current mismatch", unit: "A", none: "not compared" },
  { key: "safety.soft_start_s", label: "Soft start", unit: "s", none: "at once" },
  { key: "safety.guard", label: "Guard", choices: ["refuse", "warn", "off"] },
  { key: "safety.passivity", label: "Passivity", choices: ["off", "observe", "control"] },
];


export class Controls {
  /**
   * @param {(plane: any) => void} dream shows a setting not yet sent; null: none
   * @param {() => import("./quantity.js").Quantity} deflection the motion that the plane is drawn for
   */
  constructor(dream, deflection) {
    this.dream = dream;
    this.deflection = deflection;
    this.linear = false;
    /** @type {any} */ this.config = null;
    /** @type {Map<string, Control>} */ this.controls = new Map();
    this.asked = 0;
    /** @type {any} */ this.timer = undefined;
    this.built = "";
  }

  /** @param {any} config @param {boolean} linear */
  confirm(config, linear) {
    this.config = config;
    if (this.built !== String(linear)) {
      this.built = String(linear);
      this.linear = linear;
      const build = (/** @type {Setting} */ setting) => {
        const control = new Control(setting, this);
        this.controls.set(setting.key, control);
        return control.box;
      };
      byId("settings").replaceChildren(...SETTINGS.map(build));
      byId("limit-settings").replaceChildren(...LIMITS.map(build));
    }
    this.controls.get("dither.amplitude")?.inUnit(config.dither.target === "current" ? "A" : "ticks");
    for (const [key, control] of this.controls) control.confirmed(lookUp(config, key));
  }

  /** Take back what is being dragged: a stop leaves nothing that letting go would send. */
  withdraw() {
    clearTimeout(this.timer);
    this.asked++;
    this.dream(null);
    for (const [key, control] of this.controls) control.withdraw(lookUp(this.config, key));
  }

  /** Ask where values would land, not more often than every 60 ms. @param {Record<string, any>} settings */
  preview(settings) {
    clearTimeout(this.timer);
    const number = ++this.asked;
    this.timer = setTimeout(async () => {
      try {
        const plane = await ask("preview", { settings, deflection: this.deflection() });
        if (number === this.asked) this.dream(plane);
      } catch {
        if (number === this.asked) this.dream(null);
      }
    }, PREVIEW_MS);
  }

  /** Send a value, or what was typed. @param {Control} control @param {any} value @param {boolean} [force] @param {Record<string, any>} [more] settings together with it */
  async set(control, value, force = false, more = {}) {
    control.waiting();
    try {
      await ask("set", { settings: { [control.setting.key]: value, ...more }, force });
      control.refused("");
    } finally {
      control.box.classList.remove("waiting");
    }
  }

  /** Send what a slider or a list was set to. @param {Control} control @param {any} value @param {Record<string, any>} [more] settings together with it */
  async send(control, value, more = {}) {
    clearTimeout(this.timer);
    this.asked++;
    try {
      await this.set(control, value, false, more);
    } catch (error) {
      this.explain(control, value, error);
      control.confirmed(lookUp(this.config, control.setting.key));
    }
    this.dream(null);
  }

  /** Say a refusal at its control; a remedy for another setting goes together with what was asked for. @param {Control} control @param {any} value @param {unknown} error */
  explain(control, value, error) {
    const { key } = control.setting;
    showRefusal(control.error, error, {
      what: `${key} = ${typeof value === "object" ? value.text : value}`,
      apply: (remedy) => (remedy.key === "spring.origin" ? ask("origin", { force: false }) : this.set(control, value, false, { [remedy.key]: remedy.after })),
      force: () => this.set(control, value, true),
    });
  }
}

class Control {
  /** @param {Setting} setting @param {Controls} owner */
  constructor(setting, owner) {
    this.setting = setting;
    this.owner = owner;
    const id = `set-${setting.key.replace(".", "-")}`;
    this.range = (owner.linear && setting.linearRange) || setting.range || [0, 1];
    this.unit = (owner.linear && setting.linearUnit) || setting.unit || "";
    this.dragging = false;
    /** Whether a pointer holds the slider, and whether a stop has taken back what it drags. */
    this.pressed = false;
    this.withdrawn = false;
    this.unitText = make("span", { class: "unit" }, this.unit);
    this.confirmedText = make("output", { class: "confirmed", id: `${id}-confirmed`, title: "as the daemon confirmed it" }, "–");
    this.error = make("div", { class: "refusal", id: `${id}-refusal`, role: "alert" });
    this.box = make("div", { class: "setting" }, make("label", { for: id }, setting.label), this.unitText, this.confirmedText);
    if (setting.choices) {
      this.select = /** @type {HTMLSelectElement} */ (make("select", { id }, ...setting.choices.map((choice) => make("option", { value: choice }, choice))));
      this.select.addEventListener("change", () => owner.send(this, this.select?.value));
      this.box.append(this.select);
    } else if (setting.none) {
      const entry = /** @type {HTMLInputElement} */ (make("input", { id, type: "text", inputmode: "decimal" }));
      this.enter(entry);
      this.box.append(make("span", { class: "fill" }), entry);
    } else {
      const slider = /** @type {HTMLInputElement} */ (make("input", { id, type: "range", min: "0", max: String(STEPS), step: "1", "aria-describedby": `${id}-confirmed` }));
      const entry = /** @type {HTMLInputElement} */ (make("input", { id: `${id}-entry`, type: "text", inputmode: "decimal", "aria-label": `${setting.label} as a number` }));
      this.slider = slider;
      slider.addEventListener("pointerdown", () => Object.assign(this, { pressed: true, withdrawn: false }));
      for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, () => (this.pressed = false), true);
      slider.addEventListener("input", () => {
        if (!this.pressed) this.withdrawn = false; // by the keyboard
        if (this.withdrawn) return;
        this.dragging = true;
        entry.value = number(this.shown(this.value()));
        this.field?.show();
        owner.preview({ [setting.key]: this.value() });
      });
      slider.addEventListener("change", () => {
        this.dragging = false;
        this.field?.withdraw();
        if (this.withdrawn) this.confirmed(lookUp(owner.config, setting.key));
        else owner.send(this, this.value());
      });
      this.enter(entry);
      this.box.append(slider, entry);
    }
    this.box.append(this.error);
  }

  /** What is typed into a field is a value of this setting. @param {HTMLInputElement} entry */
  enter(entry) {
    const { setting, owner } = this;
    this.field = new Field(entry, () => (setting.factor ? this.unit : ""), (said) => owner.set(this, said), this.error);
    this.field.explain = (error) => owner.explain(this, this.field?.said(), error);
  }

  /** @param {number} value */
  shown(value) {
    return value * (this.setting.factor ?? 1);
  }

  /** What the slider stands at. */
  value() {
    const part = Number(this.slider?.value) / STEPS;
    const [low, high] = this.range;
    if (this.setting.zero && part === 0) return 0;
    const shown = this.setting.log ? low * (high / low) ** part : low + (high - low) * part;
    if (this.setting.whole) return Math.round(shown);
    return Number((shown / (this.setting.factor ?? 1)).toPrecision(3));
  }

  waiting() {
    this.box.classList.add("waiting");
  }

  /** @param {any} value */
  confirmed(value) {
    this.box.classList.remove("waiting");
    const { none } = this.setting;
    this.confirmedText.textContent = none && !value ? none : typeof value === "number" ? number(this.shown(value)) : String(value);
    if (this.select) this.select.value = String(value);
    if (none) this.field?.settle(number(value ?? 0));
    if (!this.slider || this.dragging) return;
    const [low, high] = this.range;
    const shown = this.shown(Number(value));
    const part = this.setting.log ? Math.log(Math.max(shown, 1e-30) / low) / Math.log(high / low) : (shown - low) / (high - low);
    this.slider.value = String(Math.round(STEPS * Math.min(1, Math.max(0, part))));
    this.field?.settle(number(shown));
  }

  /** @param {any} value in force */
  withdraw(value) {
    if (this.dragging || this.pressed) this.withdrawn = true;
    this.dragging = false;
    this.confirmed(value);
  }

  /** @param {string} unit of what is shown and typed */
  inUnit(unit) {
    this.unit = unit;
    this.unitText.textContent = unit;
  }

  /** @param {string} why */
  refused(why) {
    this.box.classList.remove("waiting");
    this.error.textContent = why;
  }
}
