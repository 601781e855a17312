// How the loop and this page are: lateness, grants, energies, recorder, drops.
// @ts-check

import { byId, duration, make, number, say, svg } from "./dom.js";

/** @typedef {{bounds_s: (number | null)[], below: number[]}} Histogram */

const WIDTH = 380;
const HEIGHT = 84;

/** Bars over 1-2-5 bounds, the counts on a logarithmic scale. @param {string} place @param {string} title @param {Histogram} histogram */
function bars(place, title, histogram) {
  const counts = histogram.below.map((below, i) => below - (i ? histogram.below[i - 1] : 0));
  const total = histogram.below[histogram.below.length - 1];
  const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${title}, ${total} ticks` });
  const width = WIDTH / counts.length;
  const most = Math.log10(Math.max(10, ...counts) + 1);
  counts.forEach((count, i) => {
    const height = (Math.log10(count + 1) / most) * (HEIGHT - 28);
    const bound = histogram.bounds_s[i];
    const bar = svg("rect", { class: "bar", x: i * width + 2, y: HEIGHT - 14 - height, width: width - 4, height: Math.max(height, count ? 1.5 : 0) });
    bar.append(svg("title", {}, `${count} ticks up to ${bound === null ? "∞" : duration(bound)}`));
    root.append(bar, svg("text", { class: "tick", x: (i + 0.5) * width, y: HEIGHT - 3, "text-anchor": "middle" }, bound === null ? "more" : duration(bound).replace(" ", "")));
    if (count) root.append(svg("text", { class: "tick", x: (i + 0.5) * width, y: HEIGHT - 17 - height, "text-anchor": "middle" }, number(count, 2)));
  });
  byId(place).replaceChildren(root);
}

/** @param {{lateness?: Histogram, execution?: Histogram}} message */
export function showHistograms(message) {
  if (message.lateness) bars("late-histogram", "How late the loop woke", message.lateness);
  if (message.execution) bars("exec-histogram", "How long a tick took", message.execution);
}

/** @param {any} status @param {import("./store.js").Store} store */
export function showHealth(status, store) {
  const { timing, energy, recorder } = status;
  const quantiles = (/** @type {any} */ q) => `p50 ${number(q.p50, 3)}, p99 ${number(q.p99, 3)}, p99.9 ${number(q.p999, 3)}, max ${number(q.max, 3)} µs`;
  say("h-late", quantiles(timing.wake_us));
  say("h-exec", quantiles(timing.exec_us));
  say("h-missed", `${timing.missed} periods in ${timing.ticks} ticks at ${number(timing.rate_hz)} Hz`);
  say("h-exchanges", `${status.exchanges_missed} missed, ${status.commands_clamped} commands clamped`);
  const writing = recorder.path ? `${recorder.path}, ${recorder.rows} rows, ${recorder.dropped} dropped` : "off";
  say("h-recorder", recorder.error ? `stopped: ${recorder.error}` : writing);
  const seconds = store.head ? store.timeAt(store.head - 1) - store.timeAt(store.first) : 0;
  say("h-page", `${store.head - store.first} rows = ${duration(seconds)}, at most ${store.capacity} rows in ${number(store.bytes / 2 ** 20, 3)} MiB; ${store.lost} rows lost on the way`);
  const grants = (status.realtime ?? []).map((/** @type {any} */ grant) =>
    make("li", { class: grant.granted ? "good" : "bad" }, `${grant.granted ? "✓" : "✗"} ${grant.name}: ${grant.detail}${grant.granted ? "" : ` (${grant.fix})`}`),
  );
  byId("h-grants").replaceChildren(...grants);
  const joules = ["stored", "dissipated", "generated", "unexplained"].map((name) => ({ name, value: Number(energy[`${name}_J`] ?? 0) }));
  const most = Math.max(1e-12, ...joules.map(({ value }) => Math.abs(value)));
  byId("h-energy").replaceChildren(
    ...joules.map(({ name, value }) => {
      const bar = make("span", { class: `energy ${name}` });
      bar.style.width = `${(100 * Math.abs(value)) / most}%`;
      return make("div", { class: "energy-row" }, make("span", {}, name), make("span", { class: "energy-place" }, bar), make("output", {}, `${number(value, 3)} J`));
    }),
  );
}
