// What is wrong, above everything else: the latched fault with what clears it and its page, or that no daemon answers.
// @ts-check

import { byId, say } from "./dom.js";
import { openPanel } from "./panels.js";
import { markdown } from "./markdown.js";

let pageOf = "";

/** @param {string} code @returns {Promise<string>} */
async function faultPage(code) {
  const reply = await fetch(`/faults/${encodeURIComponent(code)}`);
  return reply.ok ? reply.text() : "";
}

/** @param {string} code @param {string} text */
function show(code, text) {
  say("page-title", code);
  const body = text.replace(/^# .*\n/, "") || "There is no page about this fault.";
  byId("page-text").replaceChildren(...markdown(body, (other) => faultPage(other).then((found) => show(other, found))));
  byId("page").scrollTop = 0;
}

/** @param {{code: string, cause: string} | null} fault @param {string | null} why @param {boolean} known whether a daemon answers */
export async function banner(fault, why, known) {
  const place = byId("banner");
  place.hidden = !fault && !why;
  place.className = fault ? "fault" : "lost";
  say("banner-title", fault ? `Fault: ${fault.code}` : why ? (known ? "Not all is shown" : "No daemon") : "");
  say("banner-cause", fault ? fault.cause : (why ?? ""));
  byId("clear").hidden = !fault;
  byId("fault-page").hidden = !fault;
  if (!fault) {
    pageOf = "";
    byId("banner-clear").replaceChildren();
  } else if (pageOf !== fault.code) {
    pageOf = fault.code;
    const text = await faultPage(fault.code);
    const needs = text.split(/^## How to clear\s*$/m)[1]?.split(/^## /m)[0].trim() ?? "";
    byId("banner-clear").replaceChildren(...(needs ? ["To clear: ", ...markdown(needs, () => {}).flatMap((part) => [...part.childNodes])] : []));
    show(fault.code, text);
  }
}

byId("fault-page").addEventListener("click", () => openPanel("page"));
