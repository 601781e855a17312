// What is seen, out of the page and back into it.
// @ts-check

import { byId, say } from "./dom.js";
import { decodeStream } from "./frames.js";
import { request } from "./link.js";
import { describe, makeSource } from "./source.js";
import { CHANNELS, SMALLEST, Store } from "./store.js";

/** @param {Blob} blob @param {string} name */
function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const stamp = () => new Date().toISOString().replace(/[-:]/g, "").slice(0, 15);

/** @param {Store} store @param {number} begin @param {number} end @param {Record<string, string>} units */
function saveCsv(store, begin, end, units) {
  const unit = { position: "ticks", coarse: "ticks", velocity: units.velocity, current: "A", measured: "A", force: units.force, late: "us", model: "ticks", residual: "ticks" };
  const lines = [`tick,time_s,encoder_counts_from_origin,flags,${CHANNELS.map((name) => `${name}_${unit[name].replace(/[ /]/g, "_")}`).join(",")}`];
  for (let row = begin; row < end; row++) {
    const at = row & store.mask;
    const values = CHANNELS.map((name) => {
      const value = store.channels[name].values[at];
      return Number.isFinite(value) ? String(value) : "";
    });
    lines.push(`${store.tick[at]},${store.time[at].toFixed(9)},${store.counts[at]},${store.flags[at]},${values.join(",")}`);
  }
  download(new Blob([lines.join("\n"), "\n"], { type: "text/csv" }), `scope-${stamp()}.csv`);
}

/** @param {Store} store @param {number} begin @param {number} end */
async function saveArrow(store, begin, end) {
  const reply = await request("save", new Blob(store.frames(begin, end)), { type: "application/vnd.hapticd.frames" });
  download(await reply.blob(), `scope-${stamp()}.arrow`);
}

/** @param {HTMLCanvasElement} canvas */
function savePng(canvas) {
  canvas.toBlob((blob) => blob && download(blob, `scope-${stamp()}.png`), "image/png");
}

/**
 * A run file as a source of its own, which holds all of it, in its own units.
 * @param {File} file
 * @returns {Promise<{source: import("./source.js").Source, description: any}>}
 */
async function openRun(file) {
  const reply = await request("open", file, { type: "application/vnd.apache.arrow.stream", headers: { "X-File-Name": encodeURIComponent(file.name) } });
  const { description, frames } = decodeStream(await reply.arrayBuffer());
  const rows = frames.reduce((sum, frame) => sum + frame.rows, 0);
  const source = makeSource(file.name, new Store(Math.max(SMALLEST, 2 ** Math.ceil(Math.log2(Math.max(rows, 1))))));
  describe(source, description.view);
  for (const frame of frames) source.store.append(frame);
  return { source, description };
}

/** @param {import("./view.js").View} view @param {import("./release.js").Release} release */
export function connectFiles(view, release) {
  const told = (/** @type {Promise<unknown> | void} */ done) => Promise.resolve(done).then(() => say("file-answer", ""), (error) => say("file-answer", error.message));
  const seen = (/** @type {(store: Store, begin: number, end: number) => Promise<unknown> | void} */ save) => {
    const { begin, end } = view.rows();
    return told(save(view.store, begin, end));
  };
  byId("save-csv").addEventListener("click", () => seen((store, begin, end) => saveCsv(store, begin, end, view.source.units)));
  byId("save-arrow").addEventListener("click", () => seen(saveArrow));
  byId("save-png").addEventListener("click", () => savePng(view.trace.picture()));

  const reopen = async (/** @type {File} */ file) => {
    say("file-answer", `reading ${file.name} …`);
    const { source, description } = await openRun(file);
    view.look(source);
    const start = source.store.timeAt(0);
    view.show(start, Math.max(20 * source.store.periodS, view.newest() - start), start, "a run file; the capture goes on");
    view.trace.triggerTime = NaN;
    const notes = description.warnings;
    say("file-name", `${file.name}: ${description.rows} rows${notes.length ? `; ${notes.join("; ")}` : ""}`);
  };
  byId("open-file").addEventListener("change", (event) => {
    const input = /** @type {HTMLInputElement} */ (event.target);
    if (input.files?.[0]) told(reopen(input.files[0]));
    input.value = ""; // the same file can be chosen again
  });
  for (const kind of ["dragover", "drop"]) {
    document.addEventListener(kind, (event) => {
      event.preventDefault();
      const file = /** @type {DragEvent} */ (event).dataTransfer?.files[0];
      if (kind === "drop" && file) told(reopen(file));
    });
  }
}
