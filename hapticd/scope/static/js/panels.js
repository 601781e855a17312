// Panels over the page: help, a fault's page, a question. None is modal, so that the stops stay within reach while one is
// open, and Esc closes none: it stops, always, and nothing else.
// @ts-check

import { byId } from "./dom.js";

/** @param {string} id */
export function openPanel(id) {
  const panel = byId(id, HTMLDialogElement);
  if (!panel.open) panel.show();
  /** @type {HTMLElement | null} */ (panel.querySelector("button.close"))?.focus();
  panel.scrollTop = 0; // its button is at its end
}

/** @param {string} id */
export function togglePanel(id) {
  const panel = byId(id, HTMLDialogElement);
  if (panel.open) panel.close();
  else openPanel(id);
}

for (const panel of document.querySelectorAll("dialog")) {
  panel.querySelector("button.close")?.addEventListener("click", () => panel.close());
}
