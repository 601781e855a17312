// The page: what comes in goes into the store, what is seen is drawn once a frame, and every control says what it did.
// @ts-check

import { banner } from "./banner.js";
import { Controls } from "./controls.js";
import { byId, duration, make, number, say } from "./dom.js";
import { openRun, saveArrow, saveCsv, savePng } from "./files.js";
import { FLAG, decode } from "./frames.js";
import { showHealth, showHistograms } from "./health.js";
import { ask, follow } from "./link.js";
import { Measure } from "./measure.js";
import { togglePanel } from "./panels.js";
import { Plane } from "./plane.js";
import { Field, refuseAt, withdrawAll } from "./quantity.js";
import { showRefusal, withdrawQuestions } from "./refusal.js";
import { Release } from "./release.js";
import { CHANNELS, Store, VELOCITY_WINDOW_S } from "./store.js";
import { LOOK, Trace } from "./trace.js";
import { Trigger } from "./trigger.js";

const WINDOWS = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];
const AFTER_FAULT_S = 0.3;
const BEFORE_FAULT_S = 3;
const STALE_S = 1;
const ROLL_BEHIND_S = 0.25;
const TELL_MS = 100;
const SPECTRUM_MS = 500;
const PLANE_MS = 150;

const units = { position: "rad", velocity: "rad/s", current: "A", force: "N m" };
const scales = { resolution: 1, raw_resolution: 1, decimation: 1, period_s: 1e-3 };

let live = new Store();
/** What is looked at: the live rows, or those of a run file. */
let store = live;
/** @type {any} */ let status = null;
/** @type {any} */ let hello = null;
let windowS = 2;
let from = -1;
let mayCommand = false;
let mine = false;
let faultRow = -1;
let looked = 0;
let newestUnixS = NaN;
let clockOffsetS = Infinity;
let framesDrawn = 0;
let rolled = 0;
let rolledAt = 0;

// ---- time

/** How much later than the server's our clock is, with the shortest way seen: the best that can be known. @param {number} unixS */
const heard = (unixS) => (clockOffsetS = Math.min(clockOffsetS, Date.now() / 1000 - unixS));
/** Age of the newest row. By the wall clock, which goes on while a computer sleeps. */
const age = () => Date.now() / 1000 - clockOffsetS - newestUnixS;

// ---- trace

/** @param {import("./store.js").Channel[]} channels @param {string} id @param {string} title @param {boolean} shown @param {() => string} unit */
const lane = (id, title, channels, shown, unit) => ({ id, title, channels, shown, unit });
const ticksAnd = () => `ticks of ${number(scales.resolution, 3)} ${units.position}`;
const specs = [
  lane("position", "Position", ["position", "coarse", "model"], true, ticksAnd),
  lane("residual", "Residual", ["residual"], false, ticksAnd),
  lane("velocity", "Velocity", ["velocity"], false, () => `${units.velocity}, slope over 5 ms`),
  lane("current", "Current", ["current", "measured"], true, () => "A"),
  lane("force", "Force", ["force"], false, () => units.force),
  lane("late", "Lateness", ["late"], false, () => "µs"),
];
/** @param {string} id */
const shownChannel = (id) => /** @type {import("./store.js").Channel} */ (id);

const trigger = new Trigger();
/** Why a lane is empty. @param {import("./trace.js").LaneSpec} spec @param {number} rows in view */
function whyEmpty(spec, rows) {
  if (store === live && !store.head) {
    if (!byId("offline").hidden) return "not connected: no rows come";
    if (!byId("banner").hidden) return "no daemon answers: no rows come";
    return hello ? "connected; no row has come yet" : "waiting for the daemon's configuration";
  }
  if (!rows) return "no rows in this window";
  if (spec.id === "residual") return store === live ? release.why() : "no simulation is laid over a run file";
  if (spec.id === "velocity") return `too few rows: the slope is over ${duration(VELOCITY_WINDOW_S)}`;
  return "the rows in this window have no such value";
}
const trace = new Trace(specs, whyEmpty, (event) => {
  if (event.kind === "zoom") zoom(event.factor, event.at);
  else if (event.kind === "pan") pan(event.by);
  else if (event.which === "a" || event.which === "b") trace.cursors[event.which] = event.at;
  else {
    if (trace.values.lane !== event.lane) Object.assign(trace.values, { lane: event.lane, y1: NaN, y2: NaN });
    trace.values[event.which] = event.at;
  }
});

const newest = () => (store.head ? store.timeAt(store.head - 1) : 0);

/** @param {boolean} held @param {string} [why] */
function hold(held, why = "") {
  store.held = held;
  if (held) from = trace.view[0] + trace.zero;
  else {
    trigger.reset(store.head);
    faultRow = -1;
  }
  byId("run").textContent = held ? "Run" : "Hold";
  byId("run").setAttribute("aria-pressed", String(held));
  say("hold-why", held ? why || "held: scroll back with the mouse; new rows are not taken" : "");
}

/** @param {number} factor @param {number} at */
function zoom(factor, at) {
  const wide = Math.min(60, Math.max(20 * store.periodS, windowS * factor));
  if (store.held) from = at - ((at - from) * wide) / windowS;
  windowS = wide;
  tellWindow();
}

/** @param {number} by */
function pan(by) {
  if (!store.held) hold(true);
  from = Math.min(newest() - windowS / 10, Math.max(store.head ? store.timeAt(store.first) - windowS / 2 : 0, from + by));
}

function tellWindow() {
  const select = byId("window", HTMLSelectElement);
  const known = WINDOWS.find((value) => Math.abs(value / windowS - 1) < 1e-6);
  select.value = known ? String(known) : "";
  const other = select.querySelector("option[value='']");
  if (other) other.textContent = duration(windowS);
}

/** Where a rolling trace ends: from one message to the next it moves on with the clock, and never beyond the newest row. */
function rolling() {
  const now = performance.now() / 1000;
  const behind = newest() - rolled - (now - rolledAt);
  rolled = newest() - (behind > 0 && behind < ROLL_BEHIND_S ? behind : 0);
  rolledAt = now;
  return rolled;
}

/** Which time span is seen now, and which time is called 0. @returns {[number, number, number]} */
function span() {
  if (store.held) return [from, from + windowS, Number.isFinite(trace.triggerTime) ? trace.triggerTime : newest()];
  const { mode, pre } = trigger.settings;
  const end = rolling();
  if (mode !== "roll" && trigger.at >= store.first && trigger.at >= 0) {
    const time = store.timeAt(trigger.at);
    const stale = mode === "auto" && end - time > Math.max(2 * windowS, 0.5);
    if (!stale) {
      trace.triggerTime = time;
      return [time - windowS * pre, time + windowS * (1 - pre), time];
    }
  }
  trace.triggerTime = NaN;
  return [end - windowS, end, end];
}

function frame() {
  requestAnimationFrame(frame);
  if (!store.held && trigger.settings.mode !== "roll") {
    trigger.look(store, windowS);
    if (trigger.settings.mode === "single" && trigger.full(store, windowS)) {
      span();
      from = trace.triggerTime - windowS * trigger.settings.pre;
      trace.view = [from - trace.triggerTime, from + windowS - trace.triggerTime];
      trace.zero = trace.triggerTime;
      hold(true, "single shot taken");
    }
  }
  if (faultRow >= 0 && !store.held && newest() >= store.timeAt(faultRow) + AFTER_FAULT_S) freeze();
  const [left, right, zero] = span();
  const { begin, end } = trace.draw(store, left, right, zero);
  framesDrawn++;
  document.body.dataset.frames = String(framesDrawn);
  document.body.dataset.seen = String(end - begin);
}

/** The seconds before a fault stay on the screen. */
function freeze() {
  const time = store.timeAt(faultRow);
  windowS = Math.max(windowS, BEFORE_FAULT_S);
  trace.triggerTime = time;
  const left = time + AFTER_FAULT_S - windowS;
  trace.view = [left - time, left + windowS - time];
  trace.zero = time;
  hold(true, "frozen by the fault at 0 s; Run looks at the present again");
  tellWindow();
}

// ---- what comes in

/** @param {ArrayBuffer} data */
function takeRows(data) {
  const found = decode(data);
  heard(found.unixS);
  if (!found.rows) return;
  newestUnixS = found.unixS;
  if (!hello) return; // without the scales a position cannot be told
  const before = live.head;
  live.append(found);
  for (let row = Math.max(before, 1); row < live.head; row++) {
    if (live.flags[row & live.mask] & ~live.flags[(row - 1) & live.mask] & FLAG.fault) faultRow = row;
  }
}

/** @param {string} data */
function takeState(data) {
  const message = JSON.parse(data);
  if (message.lease) showLease(message.lease);
  if (message.type === "config") takeConfig(message);
  else if (message.type === "histograms") showHistograms(message);
  else {
    heard(message.unix_s);
    status = message.status;
    showState(message.why);
  }
}

/** @param {any} message */
function takeConfig(message) {
  const decimation = hello?.scales.decimation;
  hello = message;
  Object.assign(units, message.units);
  Object.assign(scales, message.scales);
  live.rawResolution = scales.raw_resolution;
  if (decimation !== scales.decimation) for (const each of trace.lanes) each.name();
  if (!releaseFields.deflection.settled) releaseFields.deflection.settle(String(message.plane.point.deflection));
  if (!plane.data) plane.show(message.plane, units);
  showPlane();
  showEnds();
  controls.confirm(message.config, units.position === "m");
  const names = byId("excite-name");
  if (!names.children.length) names.append(...message.excitations.map((/** @type {string} */ name) => make("option", {}, name)));
}

/** The plane for the release that this page has in mind; the server's own is for another deflection. */
async function showPlane() {
  const field = releaseFields.deflection;
  try {
    plane.show(await ask("preview", { settings: {}, deflection: field.said() }), units);
    field.refuse("");
  } catch (error) {
    refuseAt(error, releaseFields);
  }
}

let endsAsked = false;
/** What starts end in; one question at a time, and another one when the config has changed meanwhile. */
async function showEnds() {
  if (endsAsked) return;
  endsAsked = true;
  for (let asked = null; asked !== hello; ) {
    asked = hello;
    say("ends", "being worked out");
    const found = await ask("ends", {}).catch(() => null);
    say("ends", found ? found.words : "–");
  }
  endsAsked = false;
}

/** @param {string | null} why */
function showState(why) {
  const state = status ? status.state : "unreachable";
  say("state", state);
  document.body.dataset.state = state;
  say("rate", status ? `${number(status.timing.rate_hz)} Hz` : "–");
  say("missed", status ? `${status.timing.missed} periods missed` : "");
  banner(status?.fault ?? null, why, Boolean(status));
  if (!status) return;
  showHealth(status, live);
  release.look(status);
  const { experiment } = status;
  const running = experiment && experiment.state === "running";
  say("experiment", running ? `${experiment.kind}, ${Math.round(100 * experiment.progress)} %` : "");
  byId("record").textContent = status.recorder.path ? "Stop recording" : "Record";
}

/** @param {{mine: boolean, free: boolean, may: boolean}} lease */
function showLease(lease) {
  mayCommand = lease.may;
  mine = lease.mine && lease.may;
  document.body.dataset.control = mine ? "mine" : lease.may ? "other" : "view";
  say("lease", mine ? "this page has the controls" : lease.may ? (lease.free ? "the controls are free" : "another page has the controls") : "view only");
  const take = byId("take");
  take.hidden = !lease.may;
  take.textContent = mine ? "Give back" : lease.free ? "Take" : "Take over";
  for (const each of document.querySelectorAll("fieldset.commands")) /** @type {HTMLFieldSetElement} */ (each).disabled = !mine;
  for (const id of ["stop", "estop"]) byId(id, HTMLButtonElement).disabled = !mayCommand;
}

// ---- settings, release, and the other commands

const plane = new Plane();
const releaseFields = {
  deflection: new Field(byId("release-deflection", HTMLInputElement), () => "ticks", null, byId("release-deflection-refusal")),
  duration_s: new Field(byId("release-duration", HTMLInputElement), () => "s", null, byId("release-duration-refusal")),
};
const controls = new Controls((found) => plane.dream(found), () => ({ text: plane.deflection, unit: "ticks" }));
const release = new Release(
  () => live,
  () => {
    look(live);
    hold(false);
  },
  (running) => {
    if (running.start < live.first || store !== live) return;
    const start = live.timeAt(running.start);
    const residual = specs.find((spec) => spec.id === "residual");
    if (residual && !residual.shown) {
      residual.shown = true;
      trace.rebuild();
      showLanes();
    }
    const lasted = Math.max(0.05, Math.min(running.durationS, newest() - start));
    windowS = lasted * 1.1;
    trace.triggerTime = start;
    trace.zero = start;
    trace.view = [-0.05 * lasted, 1.05 * lasted];
    hold(true, "the release, taken as a single shot; Run looks at the present again");
    tellWindow();
  },
);

/** Run a command and say at its place how it went. @param {string} name @param {any} body @param {string} place */
async function command(name, body, place) {
  try {
    const answer = await ask(name, body);
    say(place, "");
    return answer;
  } catch (error) {
    showRefusal(byId(place), error, {
      what: name,
      apply: async (remedy) => {
        if (remedy.key === "spring.origin") await ask("origin", { force: false });
        else await ask("set", { settings: { [remedy.key]: remedy.after }, force: false });
        say(place, `${remedy.key} is ${number(remedy.after, 6)} ${remedy.unit}; ${name} tries again`);
      },
      force: () => ask(name, { ...body, force: true }).then(() => say(place, "")),
    });
    return null;
  }
}

// A pressed button lets the focus go: the next press on the space bar holds the trace, and moves nothing.
document.addEventListener("click", (event) => {
  const button = /** @type {HTMLElement} */ (event.target).closest("button:not([role=tab])");
  if (button && (event.detail > 0 || button.closest(".commands"))) /** @type {HTMLElement} */ (button).blur();
});
byId("start").addEventListener("click", async () => {
  look(live);
  hold(false);
  await command("start", { force: false }, "command-answer");
});
byId("origin").addEventListener("click", async () => {
  const answer = await command("origin", { force: false }, "command-answer");
  if (answer) say("command-answer", `spring.origin = ${number(answer.applied["spring.origin"], 6)} ${units.position}, where the shaft is`);
});
byId("clear").addEventListener("click", () => command("clear", {}, "command-answer"));
byId("record").addEventListener("click", () => command("record", { on: !status?.recorder.path }, "command-answer"));
byId("take").addEventListener("click", async () => {
  const answer = await command("lease", { take: !mine }, "command-answer");
  if (answer) showLease({ ...answer, may: true });
});
byId("release-form").addEventListener("submit", (event) => {
  event.preventDefault();
  release.begin(releaseFields);
});
/** @type {any} */ let planeDue = undefined;
byId("release-deflection").addEventListener("input", () => {
  clearTimeout(planeDue);
  planeDue = setTimeout(showPlane, PLANE_MS);
});
// what was refused is not what would be asked for now
byId("release-form").addEventListener("input", () => say("release-answer", ""));
byId("excite-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  look(live);
  hold(false);
  const answer = await command("excite", { name: byId("excite-name", HTMLSelectElement).value, force: false }, "excite-answer");
  if (answer) say("excite-answer", `${duration(answer.duration_s)}, recorded to ${answer.run}`);
});
byId("help").addEventListener("click", () => togglePanel("keys"));

// ---- the trace's own controls

byId("run").addEventListener("click", () => hold(!store.held));
const windowSelect = byId("window", HTMLSelectElement);
windowSelect.append(...WINDOWS.map((value) => make("option", { value: String(value) }, duration(value))), make("option", { value: "", hidden: "" }, ""));
windowSelect.addEventListener("change", () => {
  if (windowSelect.value) windowS = Number(windowSelect.value);
  tellWindow();
});

function showLanes() {
  byId("lane-choice").replaceChildren(
    ...specs.map((spec, i) => {
      const box = /** @type {HTMLInputElement} */ (make("input", { type: "checkbox", id: `lane-${spec.id}` }));
      box.checked = spec.shown;
      box.addEventListener("change", () => {
        spec.shown = box.checked;
        trace.rebuild();
      });
      return make("label", { title: `key ${i + 1}` }, box, spec.title);
    }),
  );
}
showLanes();

const channelNames = CHANNELS.filter((name) => name !== "model" && name !== "residual");
const channelOptions = () => CHANNELS.map((name) => make("option", { value: name }, LOOK[name].label));
byId("trigger-channel").append(...channelNames.map((name) => make("option", { value: name }, LOOK[name].label)));
byId("measure-channel").append(...channelOptions());

/** @param {Record<string, import("./quantity.js").Quantity>} said @returns {Promise<Record<string, number>>} */
const quantities = (said) => ask("quantities", { fields: said });
/** @param {string} id @param {() => string} unit @param {(value: number) => Partial<import("./trigger.js").TriggerSettings>} settings that it means */
function triggerField(id, unit, settings) {
  const input = byId(`trigger-${id}`, HTMLInputElement);
  return new Field(
    input,
    unit,
    async (said) => {
      Object.assign(trigger.settings, settings((await quantities({ [id]: said }))[id]));
      newTrigger();
    },
    byId("trigger-refusal"),
  );
}
const levelField = triggerField("level", triggerUnit, (level) => ({ level }));
const hysteresisField = triggerField("hysteresis", triggerUnit, (value) => ({ hysteresis: Math.abs(value) }));
triggerField("holdoff", () => "ms", (value) => ({ holdoffS: Math.max(0, value / 1e3) }));
triggerField("pre", () => "%", (value) => ({ pre: Math.min(1, Math.max(0, value / 100)) }));

function triggerUnit() {
  return channelUnit(trigger.settings.channel);
}

/** What a channel is counted in. @param {import("./store.js").Channel} channel */
function channelUnit(channel) {
  return { position: "ticks", coarse: "ticks", model: "ticks", residual: "ticks", velocity: units.velocity, current: "A", measured: "A", force: units.force, late: "µs" }[channel];
}

/** A hysteresis that noise of a channel does not pass: half a tick, two counts, and what comes of them. @param {import("./store.js").Channel} channel */
function usualHysteresis(channel) {
  const { stiffness } = hello?.config.spring ?? { stiffness: 0 };
  const half = 0.5 * scales.resolution * stiffness;
  const amperes = half / (hello?.config.amplifier.torque_constant ?? 1);
  const usual = { position: 0.5, coarse: 0.5, model: 0.5, residual: 0.5, velocity: (2 * scales.raw_resolution) / VELOCITY_WINDOW_S, current: amperes, measured: amperes, force: half, late: 5 }[channel];
  return Number(usual.toPrecision(2));
}

function readTrigger() {
  const read = (/** @type {string} */ id) => byId(id, HTMLSelectElement).value;
  const channel = shownChannel(read("trigger-channel"));
  if (channel !== trigger.settings.channel) {
    // a level in ticks is none in ampere
    Object.assign(trigger.settings, { channel, level: 0, hysteresis: usualHysteresis(channel) });
    levelField.settle("0");
    hysteresisField.settle(String(trigger.settings.hysteresis));
  }
  Object.assign(trigger.settings, { mode: read("trigger-mode"), on: read("trigger-on") });
  newTrigger();
}

/** What the trigger does, and what it waits for. */
function triggerWords() {
  const { on, level, hysteresis, channel } = trigger.settings;
  const unit = channelUnit(channel);
  const up = on === "rising";
  const state = trigger.state(store);
  if (state === "off") return "";
  if (state === "fired") return `fired ${store.head && trigger.at >= 0 ? `at ${duration(store.timeAt(trigger.at) - trace.zero)}` : ""}`;
  const other = number(level + (up ? -1 : 1) * hysteresis);
  if (state === "waiting") return `waiting: it must first be ${up ? "below" : "above"} ${other} ${unit}`;
  const what = { fault: "a fault", settings: "a changed setting", release: "the start of rendering", rising: "", falling: "" }[on];
  return `armed: fires at ${what || `${number(level)} ${unit}, ${on}`}`;
}

function newTrigger() {
  const { mode, on, channel, level } = trigger.settings;
  const edge = on === "rising" || on === "falling";
  const spec = specs.find((each) => each.channels.includes(shownChannel(channel)));
  trace.level = mode !== "roll" && edge && spec ? { lane: spec.id, level } : null;
  for (const id of ["trigger-channel", "trigger-level", "trigger-hysteresis"]) /** @type {HTMLInputElement} */ (byId(id)).disabled = mode === "roll" || !edge;
  for (const id of ["trigger-on", "trigger-holdoff", "trigger-pre"]) /** @type {HTMLInputElement} */ (byId(id)).disabled = mode === "roll";
  for (const place of document.querySelectorAll(".trigger-unit")) place.textContent = edge ? channelUnit(channel) : "";
  trigger.reset(store.head);
  if (store.held && store === live) hold(false);
}
for (const each of byId("trigger").querySelectorAll("select")) each.addEventListener("change", readTrigger);
readTrigger();

/** @param {Store} next */
function look(next) {
  if (store === next) return;
  store = next;
  trace.triggerTime = NaN;
  Object.assign(trace.cursors, { a: NaN, b: NaN });
  byId("file").hidden = next === live;
  for (const each of trace.lanes) each.low = each.high = NaN;
}

// ---- tabs

const tabs = /** @type {HTMLElement[]} */ ([...document.querySelectorAll("[role=tab]")]);
/** @param {HTMLElement} chosen */
function openTab(chosen) {
  for (const tab of tabs) {
    const open = tab === chosen;
    tab.setAttribute("aria-selected", String(open));
    tab.tabIndex = open ? 0 : -1;
    byId(String(tab.getAttribute("aria-controls"))).hidden = !open;
  }
}
tabs.forEach((tab, i) => {
  tab.addEventListener("click", () => openTab(tab));
  tab.addEventListener("keydown", (event) => {
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (!step) return;
    const next = tabs[(i + step + tabs.length) % tabs.length];
    openTab(next);
    next.focus();
    event.stopPropagation();
  });
});

// ---- measuring, and what is said ten times a second

const measure = new Measure();
let spectrumAt = 0;
function tell() {
  const stale = !Number.isFinite(age()) || age() > STALE_S;
  say("age", Number.isFinite(age()) ? `${age() < 0.1 ? "< 0.1 s" : duration(Math.round(age() * 10) / 10)} old` : "no data yet");
  byId("age").classList.toggle("bad", stale);
  say("trigger-state", triggerWords());
  byId("trigger-state").dataset.state = trigger.state(store);
  say("gaps", store === live ? `${store.lost} rows lost on the way` : `${store.missed} periods missed in this run`);
  const row = store.held && Number.isFinite(trace.hover) ? Math.min(store.rowAt(trace.hover), store.head - 1) : store.head - 1;
  for (const each of trace.lanes) {
    for (const channel of each.spec.channels) {
      const value = row >= 0 ? store.value(channel, row) : NaN;
      let text = number(value);
      if (channel === "position" && Number.isFinite(value)) text = `${number(value)} = ${number(store.counts[row & store.mask] * store.rawResolution)} ${units.position}`;
      say(`value-${channel}`, text);
    }
  }
  if (!byId("tab-measure").hidden) {
    const channel = shownChannel(byId("measure-channel", HTMLSelectElement).value);
    const inTicks = ["position", "coarse", "model", "residual"].includes(channel);
    const unit = inTicks ? units.position : channelUnit(channel);
    const { begin, end } = measure.tell(store, trace, channel, { unit, perTick: inTicks ? scales.resolution : 0 });
    if (performance.now() - spectrumAt > SPECTRUM_MS) {
      spectrumAt = performance.now();
      measure.draw(store, channel, begin, end, hello?.plane.point.cycle?.hz ?? NaN);
    }
  }
  const drawn = framesDrawn - looked;
  looked = framesDrawn;
  document.body.dataset.fps = String(Math.round((drawn * 1000) / TELL_MS));
}
setInterval(tell, TELL_MS);

// ---- files

const seen = () => {
  const [left, right] = [trace.view[0] + trace.zero, trace.view[1] + trace.zero];
  return { begin: store.rowAt(left), end: store.rowAt(right) };
};
byId("save-csv").addEventListener("click", () => saveCsv(store, seen().begin, seen().end, units));
byId("save-png").addEventListener("click", () => savePng(trace.picture()));
byId("save-arrow").addEventListener("click", () => {
  saveArrow(store, seen().begin, seen().end).then(() => say("file-answer", ""), (error) => say("file-answer", error.message));
});
/** @param {File} file */
async function reopen(file) {
  say("file-answer", `reading ${file.name} …`);
  try {
    const { store: opened, description } = await openRun(file);
    look(opened);
    windowS = Math.max(20 * opened.periodS, newest() - opened.timeAt(0));
    from = opened.timeAt(0);
    trace.zero = from;
    trace.triggerTime = from;
    trace.view = [0, windowS];
    hold(true, "a run file");
    from = opened.timeAt(0);
    const notes = [...description.warnings];
    say("file-name", `${file.name}: ${description.rows} rows${notes.length ? `; ${notes.join("; ")}` : ""}`);
    say("file-answer", "");
    tellWindow();
  } catch (error) {
    say("file-answer", error instanceof Error ? error.message : String(error));
  }
}
byId("open-file").addEventListener("change", (event) => {
  const file = /** @type {HTMLInputElement} */ (event.target).files?.[0];
  if (file) reopen(file);
});
byId("back").addEventListener("click", () => {
  look(live);
  hold(false);
});
for (const kind of ["dragover", "drop"]) {
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    const file = /** @type {DragEvent} */ (event).dataTransfer?.files[0];
    if (kind === "drop" && file) reopen(file);
  });
}

// ---- theme and keyboard

const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
byId("theme").addEventListener("click", () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  localStorage.setItem("theme", dark ? "light" : "dark");
  trace.redraw();
});

/** A stop leaves nothing behind that a later Enter, or a slider let go, would send. */
function withdraw() {
  withdrawAll();
  withdrawQuestions();
  controls.withdraw();
}
for (const id of ["stop", "estop"]) byId(id).addEventListener("click", withdraw);
window.addEventListener("keydown", (event) => event.key === "Escape" && withdraw(), true);

document.addEventListener("keydown", (event) => {
  const target = /** @type {HTMLElement} */ (event.target);
  if (event.ctrlKey || event.metaKey || event.altKey || target.matches("input:not([type=checkbox]), select, textarea")) return;
  const middle = trace.view[0] + trace.zero + windowS / 2;
  /** @type {Record<string, () => void>} */
  const keys = {
    " ": () => hold(!store.held),
    "+": () => zoom(0.8, middle),
    "-": () => zoom(1.25, middle),
    ArrowLeft: () => pan(-windowS / 10),
    ArrowRight: () => pan(windowS / 10),
    a: () => (trace.cursors.a = Number.isFinite(trace.hover) ? trace.hover : middle),
    b: () => (trace.cursors.b = Number.isFinite(trace.hover) ? trace.hover : middle),
    c: () => {
      Object.assign(trace.cursors, { a: NaN, b: NaN });
      Object.assign(trace.values, { y1: NaN, y2: NaN });
    },
    "[": () => (trace.cursors.a -= windowS / 200),
    "]": () => (trace.cursors.a += windowS / 200),
    "{": () => (trace.cursors.b -= windowS / 200),
    "}": () => (trace.cursors.b += windowS / 200),
    t: () => {
      byId("trigger-mode", HTMLSelectElement).value = "single";
      readTrigger();
      hold(false);
    },
    "?": () => togglePanel("keys"),
  };
  const number = Number(event.key);
  if (number >= 1 && number <= specs.length) byId(`lane-${specs[number - 1].id}`).click();
  else if (keys[event.key] && !(event.key === " " && target.matches("button"))) keys[event.key]();
  else return;
  event.preventDefault();
});

// ---- begin

tellWindow();
plane.draw();
follow("rows", takeRows, () => {});
follow("state", takeState, (open, why) => {
  byId("offline").hidden = open;
  say("offline-why", open ? "" : why);
  if (!open) {
    document.body.dataset.state = "unreachable";
    say("state", "unreachable");
  }
});
requestAnimationFrame(frame);
document.body.dataset.ready = "yes";
