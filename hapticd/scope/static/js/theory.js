// The plane beside the trace: of the release in mind, with where a dragged setting would land; or of the run that is looked at.
// @ts-check

import { byId, say } from "./dom.js";
import { ask } from "./link.js";
import { Plane } from "./plane.js";
import { refuseAt } from "./quantity.js";

const PREVIEW_MS = 150;

export class Theory {
  /** @param {import("./view.js").View} view @param {Record<string, import("./quantity.js").Field>} fields of the release */
  constructor(view, fields) {
    this.view = view;
    this.fields = fields;
    this.plane = new Plane();
    this.dragging = false;
    this.asking = false;
    this.asked = 0;
    this.ends = "";
    /** @type {any} */ this.due = undefined;
    fields.deflection.input.addEventListener("input", () => {
      clearTimeout(this.due);
      this.due = setTimeout(() => this.ask(), PREVIEW_MS);
    });
    this.plane.draw();
  }

  /** The release that the live plane is drawn for, as the server reads it. @returns {import("./quantity.js").Quantity} */
  get deflection() {
    return { text: String(this.view.live.plane?.point.deflection ?? ""), unit: "ticks" };
  }

  /** Another config. */
  configured() {
    const { deflection } = this.fields;
    if (!deflection.settled) deflection.settle(this.deflection.text);
    this.show();
    this.ask();
    this.askEnds();
  }

  /** The live plane for the release that this page has in mind; the server's own is for another deflection. */
  async ask() {
    const { deflection } = this.fields;
    const number = ++this.asked;
    try {
      const plane = await ask("preview", { settings: {}, deflection: deflection.said() });
      if (number !== this.asked) return; // the answer to what was asked last is on its way
      this.view.live.plane = plane;
      deflection.refuse("");
      this.show();
    } catch (error) {
      if (number === this.asked) refuseAt(error, this.fields);
    }
  }

  /** A setting that is dragged belongs to the live device, also while a file is looked at. @param {import("./plane.js").PlaneData | null} found */
  dream(found) {
    if (this.dragging !== Boolean(found)) {
      this.dragging = Boolean(found);
      this.show();
    }
    this.plane.dream(found);
  }

  /** The plane of what is looked at. */
  show() {
    const source = this.dragging ? this.view.live : this.view.source;
    say("plane-of", source.name ? `Of the run ${source.name}` : "");
    byId("no-plane").hidden = Boolean(source.plane) || !source.name;
    byId("theory").classList.toggle("none", !source.plane);
    if (source.plane) this.plane.show(source.plane, source.units, !source.name);
    say("ends", source.name ? "not worked out for a file" : this.ends);
  }

  /** What starts end in; one question at a time, and another one when the config has changed meanwhile. */
  async askEnds() {
    if (this.asking) return;
    this.asking = true;
    for (let asked = null; asked !== this.view.live.config; ) {
      asked = this.view.live.config;
      this.ends = "being worked out";
      this.show();
      const found = await ask("ends", {}).catch(() => null);
      this.ends = found ? found.words : "–";
      this.show();
    }
    this.asking = false;
  }
}
