// The y range of a lane, the X–Y lane among them: as the values are, or as it is typed, zoomed with the wheel and dragged.
// @ts-check

import { make, number } from "./dom.js";

const NUMBER = /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i;
const ZOOM = 1.25;

/** @typedef {{id: string, title: string, fixed?: [number, number] | null}} Spec fixed: in the values' own unit; null: as the values are */

/** What has a y range. */
export class Ranged {
  /** @param {Spec} spec @param {HTMLElement} head where its fields are */
  constructor(spec, head) {
    this.spec = spec;
    this.head = head;
    /** How many of the shown unit one of the values' own is. */
    this.factor = 1;
    this.low = NaN;
    this.high = NaN;
    /** As the values are. @type {[number, number]} */
    this.auto = [-1, 1];
  }

  /** In the shown unit; what was fixed is so at once, before it is drawn. @returns {[number, number]} */
  get range() {
    const { fixed } = this.spec;
    return fixed ? [fixed[0] * this.factor, fixed[1] * this.factor] : this.auto;
  }

  /** Show values between two of the shown unit; null: as the values are. @param {[number, number] | null} range */
  fix(range) {
    this.spec.fixed = range && [range[0] / this.factor, range[1] / this.factor];
    [this.low, this.high] = [NaN, NaN];
    this.tellRange(true);
  }

  /** Zoom about a value, or move by one, of the shown unit. @param {number} factor @param {number} at @param {number} [by] */
  zoomY(factor, at, by = 0) {
    const [low, high] = this.range;
    this.fix([at + (low - at) * factor + by, at + (high - at) * factor + by]);
  }

  /** What the y range is, where it is typed. @param {boolean} [all] also in the field that has the focus */
  tellRange(all = false) {
    const { fixed } = this.spec;
    const auto = /** @type {HTMLElement | null} */ (this.head.querySelector(".y-auto"));
    auto?.setAttribute("aria-pressed", String(!fixed));
    this.head.querySelectorAll("input").forEach((input, i) => {
      if (all || input !== document.activeElement) input.value = fixed ? number(fixed[i] * this.factor, 4) : "";
    });
  }
}

/** The fields in a lane's head. @param {Ranged} lane */
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
  listen(axis, lane, (event) => plot.posToVal(event.clientY - plot.over.getBoundingClientRect().top, "y"));
}

/** @param {HTMLElement} axis @param {Ranged} lane @param {(event: PointerEvent | WheelEvent) => number} valueAt */
export function listen(axis, lane, valueAt) {
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
