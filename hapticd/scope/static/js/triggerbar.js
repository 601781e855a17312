// The trigger's fields: levels in the unit of its channel, read by the server as everything that is typed; and what it does.
// @ts-check

import { byId, duration, make, number, say } from "./dom.js";
import { ask } from "./link.js";
import { Field } from "./quantity.js";
import { channelUnit } from "./source.js";
import { CHANNELS, DERIVED, VELOCITY_WINDOW_S } from "./store.js";
import { LOOK } from "./lane.js";

/** @typedef {import("./trigger.js").TriggerSettings} TriggerSettings */
/** @typedef {import("./store.js").Channel} Channel */

const EVENTS = { fault: "a fault", settings: "a changed setting", release: "the start of rendering", rising: "", falling: "" };

export class TriggerBar {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    this.view = view;
    this.trigger = view.trigger;
    const names = CHANNELS.filter((name) => !["model", "residual", ...DERIVED].includes(name));
    byId("trigger-channel").append(...names.map((name) => make("option", { value: name }, LOOK[name].label)));
    this.level = this.field("level", () => this.unit(), (level) => ({ level }));
    this.hysteresis = this.field("hysteresis", () => this.unit(), (value) => ({ hysteresis: Math.abs(value) }));
    this.field("holdoff", () => "ms", (value) => ({ holdoffS: Math.max(0, value / 1e3) }));
    this.field("pre", () => "%", (value) => ({ pre: Math.min(1, Math.max(0, value / 100)) }));
    for (const each of byId("trigger").querySelectorAll("select")) each.addEventListener("change", () => this.read());
    this.read();
  }

  unit() {
    return channelUnit(this.trigger.settings.channel, this.view.live);
  }

  /** @param {string} id @param {() => string} unit @param {(value: number) => Partial<TriggerSettings>} settings that it means */
  field(id, unit, settings) {
    const send = async (/** @type {import("./quantity.js").Quantity} */ said) => {
      const numbers = await ask("quantities", { fields: { [id]: said } });
      Object.assign(this.trigger.settings, settings(numbers[id]));
      this.begin();
    };
    return new Field(byId(`trigger-${id}`, HTMLInputElement), unit, send, byId("trigger-refusal"));
  }

  /** A hysteresis that a channel's noise does not pass: half a tick, two counts, and what comes of them. @param {Channel} channel */
  usual(channel) {
    const { scales, config } = this.view.live;
    const force = 0.5 * scales.resolution * (config?.spring.stiffness ?? 0);
    const current = force / (config?.amplifier.torque_constant ?? 1);
    const velocity = (2 * scales.raw_resolution) / VELOCITY_WINDOW_S;
    return Number({ position: 0.5, coarse: 0.5, model: 0.5, residual: 0.5, velocity, current, measured: current, force, late: 5, derived1: 0, derived2: 0 }[channel].toPrecision(2));
  }

  read() {
    const value = (/** @type {string} */ id) => byId(id, HTMLSelectElement).value;
    const { settings } = this.trigger;
    const channel = /** @type {Channel} */ (value("trigger-channel"));
    if (channel !== settings.channel) {
      // a level in ticks is none in ampere
      Object.assign(settings, { channel, level: 0, hysteresis: this.usual(channel) });
      this.level.settle("0");
      this.hysteresis.settle(String(settings.hysteresis));
    }
    Object.assign(settings, { mode: value("trigger-mode"), on: value("trigger-on") });
    this.begin();
  }

  /** Wait anew, with the settings as they are. */
  begin() {
    const { view, trigger } = this;
    const { mode, on, channel, level } = trigger.settings;
    const edge = on === "rising" || on === "falling";
    const spec = view.trace.specs.find((each) => each.channels.includes(channel));
    view.trace.level = mode !== "roll" && edge && spec ? { lane: spec.id, level } : null;
    for (const id of ["trigger-channel", "trigger-level", "trigger-hysteresis"]) /** @type {HTMLInputElement} */ (byId(id)).disabled = mode === "roll" || !edge;
    for (const id of ["trigger-on", "trigger-holdoff", "trigger-pre"]) /** @type {HTMLInputElement} */ (byId(id)).disabled = mode === "roll";
    for (const place of document.querySelectorAll(".trigger-unit")) place.textContent = edge ? this.unit() : "";
    trigger.reset(view.live.store.head);
    if (view.held && view.isLive) view.hold(false);
  }

  single() {
    byId("trigger-mode", HTMLSelectElement).value = "single";
    this.read();
    this.view.hold(false);
  }

  tell() {
    byId("trigger-state").dataset.state = this.trigger.state(this.view.live.store);
    say("trigger-state", this.words());
  }

  /** What the trigger does, and what it waits for. */
  words() {
    const { trigger, view } = this;
    const { on, level, hysteresis } = trigger.settings;
    const { store } = view.live;
    const state = trigger.state(store);
    if (state === "off") return "";
    if (state === "fired") return `fired at ${duration(store.timeAt(trigger.at) - view.trace.zero)}`;
    if (view.held) return "held: Run arms it";
    const up = on === "rising";
    if (state === "waiting") return `waiting: it must first be ${up ? "below" : "above"} ${number(level + (up ? -1 : 1) * hysteresis)} ${this.unit()}`;
    return `armed: fires at ${EVENTS[on] || `${number(level)} ${this.unit()}, ${on}`}`;
  }
}
