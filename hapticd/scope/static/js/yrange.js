// The y range of a lane: as the values are, or as it is typed, zoomed with the wheel and dragged on the axis.
// @ts-check

import { make } from "./dom.js";

const NUMBER = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;
const ZOOM = 1.25;

/** The fields in a lane's head. @param {import("./lane.js").Lane} lane */
export function yRange(lane) {
  const { id, title } = lane.spec;
  const inputs = ["least", "largest"].map((which) =>
    /** @type {HTMLInputElement} */ (make("input", { id: `y-${which}-${id}`, size: "6", inputmode: "decimal", autocomplete: "off", "aria-label": `${which} value of ${title}` })),
  );
  const auto = make("button", { type: "button", class: "y-auto", "aria-pressed": String(!lane.spec.fixed), "aria-label": `auto: range of ${title} as its values are`, title: "the range as the values are; wheel and drag on the axis change it" }, "auto");
  auto.addEventListener("click", () => {
    lane.fix(null);
    mark(inputs, false);
  });
  for (const input of inputs) {
    input.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      const values = inputs.map(({ value }) => (NUMBER.test(value.trim()) ? Number(value) : NaN));
      const whole = values[0] < values[1];
      mark(inputs, !whole && inputs.every(({ value }) => value.trim()));
      if (whole) lane.fix([values[0], values[1]]);
    });
    input.addEventListener("blur", ({ relatedTarget }) => {
      if (!inputs.some((each) => each === relatedTarget)) lane.tellRange();
    });
  }
  return make("span", { class: "y-range" }, "y ", inputs[0], " … ", inputs[1], " ", auto);
}

/** @param {HTMLInputElement[]} inputs @param {boolean} wrong */
function mark(inputs, wrong) {
  for (const input of inputs) {
    input.setAttribute("aria-invalid", String(wrong));
    input.title = wrong ? "two numbers, the smaller one first" : "";
  }
}

/** Wheel and drag on the axis at the left; a double click there takes the range back. @param {uPlot} plot @param {import("./lane.js").Lane} lane */
export function listenToAxis(plot, lane) {
  const axis = /** @type {HTMLElement | undefined} */ (plot.root.querySelectorAll(".u-axis")[1]);
  if (!axis) return;
  axis.classList.add("y-axis");
  const { over } = plot;
  const valueAt = (/** @type {PointerEvent | WheelEvent} */ event) => plot.posToVal(event.clientY - over.getBoundingClientRect().top, "y");
  let from = NaN;
  axis.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      lane.zoomY(event.deltaY > 0 ? ZOOM : 1 / ZOOM, valueAt(event));
    },
    { passive: false },
  );
  axis.addEventListener("pointerdown", (event) => {
    from = valueAt(event);
    axis.setPointerCapture(event.pointerId);
  });
  axis.addEventListener("pointermove", (event) => {
    if (Number.isNaN(from) || valueAt(event) === from) return;
    lane.zoomY(1, 0, from - valueAt(event));
  });
  for (const end of ["pointerup", "pointercancel"]) axis.addEventListener(end, () => (from = NaN));
  axis.addEventListener("dblclick", () => lane.fix(null));
}
