// The page: what comes in goes into the capture, what is seen is drawn once a frame, and every control says what it did.
// @ts-check

import { banner } from "./banner.js";
import { Capture } from "./capture.js";
import { connectCommands } from "./commands.js";
import { Controls } from "./controls.js";
import { Derived } from "./derived.js";
import { byId, duration, make, mean, number, say } from "./dom.js";
import { Excite } from "./excite.js";
import { connectFiles } from "./files.js";
import { showHealth, showHistograms } from "./health.js";
import { connectKeys } from "./keys.js";
import { LOOK } from "./lane.js";
import { follow } from "./link.js";
import { Measure } from "./measure.js";
import { Notes } from "./notes.js";
import { togglePanel } from "./panels.js";
import { Field, withdrawAll } from "./quantity.js";
import { withdrawQuestions } from "./refusal.js";
import { nameRun, noteRun } from "./picture.js";
import { Release } from "./release.js";
import { channelUnit, makeLanes, makeSource, place, placeUnits, shownIn } from "./source.js";
import { Sequence } from "./sequence.js";
import { CHANNELS, DERIVED, Store, VELOCITY_WINDOW_S } from "./store.js";
import "./tabs.js";
import { Theory } from "./theory.js";
import { Trace } from "./trace.js";
import { Trigger } from "./trigger.js";
import { TriggerBar } from "./triggerbar.js";
import { View } from "./view.js";
import { XY } from "./xy.js";
import { ZMap } from "./zmap.js";

const STALE_S = 1;
const TELL_MS = 100;
const SPECTRUM_MS = 500;

/** What the daemon and the server last said. @type {{status: any, mine: boolean}} */
const said = { status: null, mine: false };

const live = makeSource("", new Store());
const view = new View(live, new Trigger());
const trace = new Trace(makeLanes(() => view.source), (spec) => shownIn(spec.channels[0], view.source).factor, whyEmpty, (event) => {
  if (event.kind === "zoom") view.zoom(event.factor, event.at);
  else if (event.kind === "pan") view.pan(event.by);
  else if (event.which === "a" || event.which === "b") trace.cursors[event.which] = event.at;
  else {
    if (trace.values.lane !== event.lane) Object.assign(trace.values, { lane: event.lane, y1: NaN, y2: NaN });
    trace.values[event.which] = event.at;
  }
});
view.trace = trace;
const fields = {
  deflection: new Field(byId("release-deflection", HTMLInputElement), () => "ticks", null, byId("release-deflection-refusal")),
  duration_s: new Field(byId("release-duration", HTMLInputElement), () => "s", null, byId("release-duration-refusal")),
};
const bar = new TriggerBar(view);
const theory = new Theory(view, fields);
const controls = new Controls((found) => theory.dream(found), () => theory.deflection);
const zmap = new ZMap(view, {
  preview: ({ K, B }) => controls.preview({ "spring.stiffness": K, "spring.damping": B }),
  send: ({ K, B }) => {
    const control = controls.controls.get("spring.stiffness");
    if (control) controls.send(control, K, { "spring.damping": B });
  },
  withdraw: () => controls.withdraw(),
});
const xy = new XY(view);
const release = new Release(view, fields, (begin, end) => {
  showLane("residual");
  xy.remember(begin, end);
  nameRun(live, said.status.experiment.result?.run ?? "", begin, end);
});
const excite = new Excite(view);
const sequence = new Sequence(view);
const notes = new Notes(live);
const capture = new Capture(live, (row) => (view.faultRow = row));
const measure = new Measure();
const derived = new Derived(view, showLanes);
view.changed = () => {
  derived.look();
  theory.show();
  showPlaceUnits();
};

/** Why a lane is empty. @param {import("./lane.js").LaneSpec} spec @param {number} rows in view */
function whyEmpty(spec, rows) {
  if (view.isLive && !view.store.head) {
    if (!byId("offline").hidden) return "not connected: no rows come";
    if (!byId("banner").hidden) return "no daemon answers: no rows come";
    return live.config ? "connected; no row has come yet" : "waiting for the daemon's configuration";
  }
  if (!rows) return "no rows in this window";
  if (spec.id === "residual") return view.isLive ? release.why() : "no simulation is laid over a run file";
  if (spec.id === "velocity") return `too few rows: the slope is over ${duration(VELOCITY_WINDOW_S)}`;
  return "the rows in this window have no such value";
}

const placeUnit = byId("place-unit", HTMLSelectElement);

/** Those that what is looked at can have. */
function showPlaceUnits() {
  const units = Object.keys(placeUnits(view.source));
  if ([...placeUnit.options].map(({ value }) => value).join() !== units.join()) placeUnit.replaceChildren(...units.map((unit) => make("option", { value: unit }, unit)));
  placeUnit.value = shownIn("position", view.source).unit;
}
placeUnit.addEventListener("change", () => {
  place.unit = placeUnit.value;
  trace.rename();
});

// ---- what comes in

/** @param {string} data */
function takeState(data) {
  const message = JSON.parse(data);
  if (message.lease) showLease(message.lease);
  if (message.type === "config") takeConfig(message);
  else if (message.type === "histograms") showHistograms(message);
  else {
    capture.heard(message.unix_s);
    said.status = message.status;
    showState(message.why);
  }
}

/** @param {any} message */
function takeConfig(message) {
  const before = live.config && [live.scales.resolution, live.units.position];
  capture.config(message);
  if (String(before) !== String([live.scales.resolution, live.units.position])) {
    trace.rename();
    showPlaceUnits();
  }
  theory.configured();
  zmap.show();
  controls.confirm(message.config, live.units.position === "m");
  notes.configured(message.config);
  excite.configured(message.excitations);
}

/** @param {string | null} why */
function showState(why) {
  const { status } = said;
  const state = status ? status.state : "unreachable";
  say("state", status?.enable.required && !status.enable.held ? `${state}, enable released` : state);
  document.body.dataset.state = state;
  say("rate", status ? `${number(status.timing.rate_hz)} Hz` : "–");
  say("missed", status ? `${status.timing.missed} periods missed` : "");
  banner(status?.fault ?? null, why, Boolean(status));
  if (!status) return;
  showHealth(status, live.store);
  say("limits-off", status.limits_off.length ? `off: ${status.limits_off.join(", ")}` : "");
  release.look(status);
  notes.take(status.recorder);
  noteRun(live, status.recorder.path);
  sequence.look(status.experiment);
  const { experiment } = status;
  const running = experiment && experiment.state === "running";
  say("experiment", running ? `${experiment.kind}${experiment.steps ? ` ${experiment.step} of ${experiment.steps}` : ""}, ${Math.round(100 * experiment.progress)} %` : "");
  if (status.recorder.path) mean(byId("record", HTMLButtonElement), "stop", "Stop recording");
  else mean(byId("record", HTMLButtonElement), "start", "Record");
}

/** @param {{mine: boolean, free: boolean, may: boolean}} lease */
function showLease(lease) {
  said.mine = lease.mine && lease.may;
  document.body.dataset.control = said.mine ? "mine" : lease.may ? "other" : "view";
  say("lease", said.mine ? "this page has the controls" : lease.may ? (lease.free ? "the controls are free" : "another page has the controls") : "view only");
  const take = byId("take", HTMLButtonElement);
  take.hidden = !lease.may;
  if (said.mine) mean(take, "give", "Give back");
  else mean(take, "take", lease.free ? "Take" : "Take over");
  for (const each of document.querySelectorAll("fieldset.commands")) /** @type {HTMLFieldSetElement} */ (each).disabled = !said.mine;
  for (const each of document.querySelectorAll("fieldset.may")) /** @type {HTMLFieldSetElement} */ (each).disabled = !lease.may;
  for (const id of ["stop", "estop"]) byId(id, HTMLButtonElement).disabled = !lease.may;
}

// ---- what is chosen to be seen

/** On a phone there is room for one lane. */
const narrow = matchMedia("(max-width: 560px)");

/** @param {string} id the lane that stays; "xy": that one */
function showOnly(id) {
  for (const spec of trace.specs) spec.shown = spec.id === id;
  byId("xy").hidden = id !== "xy";
  byId("lanes").hidden = id === "xy";
  trace.rebuild();
  showLanes();
}
narrow.addEventListener("change", () => narrow.matches && showOnly(trace.lanes[0]?.spec.id ?? "position"));

function showLanes() {
  byId("lane-choice").replaceChildren(
    ...trace.specs.map((spec, i) => {
      const box = /** @type {HTMLInputElement} */ (make("input", { type: "checkbox", id: `lane-${spec.id}` }));
      box.checked = spec.shown;
      box.addEventListener("change", () => {
        if (narrow.matches) return showOnly(spec.id);
        spec.shown = box.checked;
        trace.rebuild();
      });
      return make("label", { title: `key ${i + 1}` }, box, spec.title);
    }),
  );
  const box = /** @type {HTMLInputElement} */ (make("input", { type: "checkbox", id: "lane-xy" }));
  box.checked = !byId("xy").hidden;
  box.addEventListener("change", () => {
    if (narrow.matches) return showOnly("xy");
    byId("xy").hidden = !box.checked;
  });
  byId("lane-choice").append(make("label", { title: `key ${trace.specs.length + 1}` }, box, "X–Y"));
}

/** @param {string} id */
function showLane(id) {
  const spec = trace.specs.find((each) => each.id === id);
  if (!spec || spec.shown || narrow.matches) return;
  spec.shown = true;
  trace.rebuild();
  showLanes();
}

/** A stop leaves nothing behind that a later Enter, or a slider let go, would send. */
function withdraw() {
  zmap.withdraw();
  controls.withdraw(); // first: a slider that loses the focus says that it was changed
  withdrawQuestions();
  withdrawAll();
}

// ---- what is said ten times a second

const looked = { frames: 0, drawn: 0, spectrumAt: 0 };

function tell() {
  const { age } = capture;
  const { store } = view;
  say("age", Number.isFinite(age) ? `${age < 0.1 ? "< 0.1 s" : duration(Math.round(age * 10) / 10)} old` : "no data yet");
  byId("age").classList.toggle("bad", !(age <= STALE_S));
  bar.tell();
  say("gaps", view.isLive ? `${live.store.lost} rows lost on the way` : `${store.missed} periods missed in this run`);
  tellValues();
  if (!byId("tab-measure").hidden) tellMeasures();
  document.body.dataset.fps = String(Math.round(((looked.frames - looked.drawn) * 1000) / TELL_MS));
  document.body.dataset.marks = String(view.source.marks.length);
  document.body.dataset.captured = String(live.store.head);
  looked.drawn = looked.frames;
}

/** The newest values in view, or those under the mouse. */
function tellValues() {
  const { store, source } = view;
  const newest = view.held ? view.rows().end : store.head;
  const row = Math.min(view.held && Number.isFinite(trace.hover) ? store.rowAt(trace.hover) : newest - 1, store.head - 1);
  for (const lane of trace.lanes) {
    say(`note-${lane.spec.id}`, lane.spec.id === "residual" && view.isLive ? release.note : "");
    for (const channel of lane.spec.channels) {
      const value = row >= store.first && row >= 0 ? store.value(channel, row) : NaN;
      const { unit, factor } = shownIn(channel, source);
      const inUnits = channel === "position" && unit === "ticks" && Number.isFinite(value) ? ` = ${number(store.counts[row & store.mask] * store.rawResolution)} ${source.units.position}` : "";
      say(`value-${channel}`, `${number(value * factor)}${inUnits}`);
    }
  }
}

function tellMeasures() {
  const { source } = view;
  const channel = /** @type {import("./store.js").Channel} */ (byId("measure-channel", HTMLSelectElement).value);
  const unit = channelUnit(channel, source);
  const scale = unit === "ticks" ? { unit: source.units.position, perTick: source.scales.resolution } : { unit, perTick: 0 };
  const { begin, end } = measure.tell(view.store, trace, channel, scale);
  if (performance.now() - looked.spectrumAt < SPECTRUM_MS) return;
  looked.spectrumAt = performance.now();
  measure.draw(view.store, channel, begin, end, source.plane?.point.cycle?.hz ?? NaN);
}

function frame() {
  requestAnimationFrame(frame);
  document.body.dataset.seen = String(view.frame());
  xy.frame();
  document.body.dataset.frames = String(++looked.frames);
}

// ---- begin

const theme = localStorage.getItem("theme");
if (theme) document.documentElement.dataset.theme = theme;
byId("theme").addEventListener("click", () => {
  const dark = getComputedStyle(document.documentElement).colorScheme === "dark";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  localStorage.setItem("theme", dark ? "light" : "dark");
  trace.redraw();
});
byId("help").addEventListener("click", () => togglePanel("keys"));
byId("measure-channel").append(...CHANNELS.filter((name) => !DERIVED.includes(name)).map((name) => make("option", { value: name }, LOOK[name].label)));
for (const id of ["stop", "estop"]) byId(id).addEventListener("click", withdraw);
window.addEventListener("keydown", (event) => event.key === "Escape" && withdraw(), true);
connectCommands(view, showLease);
connectFiles(view, release, xy);
connectKeys(view, bar, () => notes.mark());
if (narrow.matches) showOnly("position");
else showLanes();
byId("more").addEventListener("click", () => {
  const open = byId("trigger").classList.toggle("open");
  byId("more").setAttribute("aria-expanded", String(open));
});
follow("rows", (data) => capture.rows(data), () => {});
follow("state", takeState, (open, why) => {
  byId("offline").hidden = open;
  say("offline-why", open ? "" : why);
  if (!open) {
    document.body.dataset.state = "unreachable";
    say("state", "unreachable");
  }
});
setInterval(tell, TELL_MS);
requestAnimationFrame(frame);
document.body.dataset.ready = "yes";
