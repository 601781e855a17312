// What is seen, out of the page and back into it.
// @ts-check

import { decodeStream } from "./frames.js";
import { request } from "./link.js";
import { CHANNELS, Store } from "./store.js";

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
export function saveCsv(store, begin, end, units) {
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
export async function saveArrow(store, begin, end) {
  const reply = await request("save", new Blob(store.frames(begin, end)), { type: "application/vnd.hapticd.frames" });
  download(await reply.blob(), `scope-${stamp()}.arrow`);
}

/** @param {HTMLCanvasElement} canvas */
export function savePng(canvas) {
  canvas.toBlob((blob) => blob && download(blob, `scope-${stamp()}.png`), "image/png");
}

/**
 * A run file as a store of its own, which holds all of it.
 * @param {File} file
 * @returns {Promise<{store: Store, description: any}>}
 */
export async function openRun(file) {
  const reply = await request("open", file, { type: "application/vnd.apache.arrow.stream", headers: { "X-File-Name": file.name.replace(/[^\x20-\x7e]/g, "_") } });
  const { description, frames } = decodeStream(await reply.arrayBuffer());
  const rows = frames.reduce((sum, frame) => sum + frame.rows, 0);
  const store = new Store(Math.max(1 << 16, 2 ** Math.ceil(Math.log2(Math.max(rows, 1)))));
  const encoder = description.config?.encoder;
  if (encoder) store.rawResolution = encoder.counts_per_metre ? 1 / encoder.counts_per_metre : (2 * Math.PI) / encoder.counts_per_rev;
  for (const frame of frames) store.append(frame);
  return { store, description };
}
