// What is seen, out of the page and back into it.
// @ts-check

import { byId, say } from "./dom.js";
import { decodeStream, prefixed } from "./frames.js";
import { request } from "./link.js";
import { eventsOf, marksOf } from "./notes.js";
import { compose } from "./picture.js";
import { toPng, toSvg } from "./scene.js";
import { describe, makeSource } from "./source.js";
import { SMALLEST, Store } from "./store.js";

/** @param {Blob} blob @param {string} name */
function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const stamp = () => new Date().toISOString().replace(/[-:]/g, "").slice(0, 15);

/**
 * The rows in view as a file that the server makes: as `hapticd export` writes them, with the config that is theirs.
 * @param {"csv" | "arrow"} format @param {import("./view.js").View} view @param {import("./release.js").Release} release
 */
async function save(format, view, release) {
  const { source } = view;
  const { begin, end } = view.rows();
  if (format === "csv" && release.isAwaited(source.store, begin, end)) {
    const tick = source.store.tick[begin & source.store.mask];
    say("file-answer", "waiting for the simulation of the release, which is saved with it …");
    await release.running?.simulated;
    if (tick !== source.store.tick[begin & source.store.mask]) throw new Error("the rows are gone meanwhile; hold the trace and save again");
  }
  const model = format === "csv" ? modelOf(source.store, begin, end) : null;
  const description = new TextEncoder().encode(JSON.stringify({ format, config: source.config, model: Boolean(model), events: eventsOf(source.marks, source.store, begin, end) }));
  const parts = [...prefixed(description), ...source.store.frames(begin, end), ...(model ? prefixed(new Uint8Array(model.buffer)) : [])];
  const reply = await request("save", new Blob(parts), { type: "application/vnd.hapticd.frames" });
  download(await reply.blob(), `scope-${stamp()}.${format}`);
}

/** The simulation that lies over rows; null where there is none. @param {Store} store @param {number} begin @param {number} end */
function modelOf(store, begin, end) {
  const model = new Float32Array(Math.max(0, end - begin));
  for (let row = begin; row < end; row++) model[row - begin] = store.value("model", row);
  return model.some((value) => !Number.isNaN(value)) ? model : null;
}

/** What is seen as a picture for a lab book. @param {"png" | "svg"} format @param {import("./view.js").View} view @param {import("./xy.js").XY} xy */
async function savePicture(format, view, xy) {
  // as it is now: what was chosen a moment ago may not be drawn yet
  view.frame();
  xy.draw();
  const scene = compose(view, xy);
  const blob = format === "svg" ? new Blob([toSvg(scene)], { type: "image/svg+xml" }) : await toPng(scene);
  download(blob, `scope-${stamp()}.${format}`);
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
  source.created = description.created_utc;
  source.marks = marksOf(description.events, source.store);
  return { source, description };
}

/** @param {import("./view.js").View} view @param {import("./release.js").Release} release @param {import("./xy.js").XY} xy */
export function connectFiles(view, release, xy) {
  const told = (/** @type {Promise<unknown> | void} */ done) => Promise.resolve(done).then(() => say("file-answer", ""), (error) => say("file-answer", error.message));
  byId("save-csv").addEventListener("click", () => told(save("csv", view, release)));
  byId("save-arrow").addEventListener("click", () => told(save("arrow", view, release)));
  byId("save-png").addEventListener("click", () => told(savePicture("png", view, xy)));
  byId("save-svg").addEventListener("click", () => told(savePicture("svg", view, xy)));

  const reopen = async (/** @type {File} */ file) => {
    say("file-answer", `reading ${file.name} …`);
    const { source, description } = await openRun(file);
    view.look(source);
    const start = source.store.timeAt(0);
    const { periodS } = source.store;
    view.show(start, Math.max(20 * periodS, view.newest() - start + periodS), start, "a run file; the capture goes on");
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
