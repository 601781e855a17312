// The keyboard. Esc is not here: stop.js has it, and it stops.
// @ts-check

import { byId } from "./dom.js";
import { togglePanel } from "./panels.js";

/** @param {import("./view.js").View} view @param {import("./triggerbar.js").TriggerBar} bar @param {() => void} mark */
export function connectKeys(view, bar, mark) {
  const { trace } = view;
  const middle = () => view.left + view.windowS / 2;
  const here = () => (Number.isFinite(trace.hover) ? trace.hover : middle());
  const move = (/** @type {"a" | "b"} */ which, /** @type {number} */ way) => (trace.cursors[which] += (way * view.windowS) / 200);
  /** @type {Record<string, () => void>} */
  const keys = {
    " ": () => view.hold(!view.held),
    "+": () => view.zoom(0.8, middle()),
    "-": () => view.zoom(1.25, middle()),
    ArrowLeft: () => view.pan(-view.windowS / 10),
    ArrowRight: () => view.pan(view.windowS / 10),
    a: () => (trace.cursors.a = here()),
    b: () => (trace.cursors.b = here()),
    c: () => {
      Object.assign(trace.cursors, { a: NaN, b: NaN });
      Object.assign(trace.values, { y1: NaN, y2: NaN });
    },
    "[": () => move("a", -1),
    "]": () => move("a", 1),
    "{": () => move("b", -1),
    "}": () => move("b", 1),
    t: () => bar.single(),
    m: mark,
    "?": () => togglePanel("keys"),
  };
  document.addEventListener("keydown", (event) => {
    const target = /** @type {HTMLElement} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || target.matches("input:not([type=checkbox]), select, textarea")) return;
    const digit = Number(event.key);
    const lane = [...trace.specs.map((spec) => spec.id), "xy"][digit - 1];
    if (lane) byId(`lane-${lane}`).click();
    else if (keys[event.key] && !(event.key === " " && target.matches("button, input, summary"))) keys[event.key]();
    else return;
    event.preventDefault();
  });
}
