// A refusal that leaves a choice: why, the changes each of which is enough, with a button behind each, and, behind a question,
// to do it all the same. Nothing here sets the motor in motion but the answer to that question.
// @ts-check

import { make, number } from "./dom.js";
import { Refusal } from "./link.js";

/**
 * @typedef {{key: string, before: number, after: number, unit: string, words: string, live: boolean, text?: string}} Remedy
 *   text: of the sequence with it
 * @typedef {object} Choices
 * @property {string} what is refused, as a person calls it: the question repeats it
 * @property {(remedy: Remedy) => Promise<unknown>} apply
 * @property {() => Promise<unknown>} force the same request once more, all the same
 */

/** @type {Map<HTMLElement, () => void>} */
const questions = new Map();

/** A stop takes back what was not sent: an open question, too. */
export function withdrawQuestions() {
  for (const close of questions.values()) close();
}

/**
 * Say at a place why something was refused.
 * @param {HTMLElement} place @param {unknown} error @param {Choices} choices
 */
export function showRefusal(place, error, choices) {
  questions.delete(place);
  if (!(error instanceof Refusal) || !error.choice) {
    place.textContent = error instanceof Error ? error.message : String(error);
    return;
  }
  const { reason, remedies, force } = error.choice;
  const again = async (/** @type {() => Promise<unknown>} */ act) => {
    try {
      await act();
    } catch (next) {
      showRefusal(place, next, choices);
    }
  };
  place.replaceChildren(make("p", {}, reason || error.message));
  if (remedies.length) {
    const items = remedies.map((remedy) => make("li", {}, ...remedyParts(remedy, () => again(() => choices.apply(remedy)))));
    place.append(make("p", {}, "One of these changes is enough:"), make("ul", { class: "remedies" }, ...items));
  } else if (error.choice.help) {
    place.append(make("p", {}, error.choice.help));
  }
  if (force) place.append(question(place, choices.what, () => again(choices.force)));
}

/** @param {Remedy} remedy @param {() => void} apply @returns {(Node | string)[]} */
function remedyParts(remedy, apply) {
  const values = `${number(remedy.before, 4)} → ${number(remedy.after, 6)} ${remedy.unit}`;
  /** @type {(Node | string)[]} */
  const parts = [make("code", {}, remedy.key), ` ${values}: ${remedy.words} `];
  if (!remedy.live) return [...parts, "(by hand)"];
  const button = make("button", { type: "button", class: "apply", "data-key": remedy.key }, "Apply");
  button.addEventListener("click", apply);
  return [...parts, button];
}

/** @param {HTMLElement} place @param {string} what @param {() => void} force */
function question(place, what, force) {
  const ask = make("button", { type: "button", class: "force" }, "Force …");
  const yes = make("button", { type: "button", class: "force-yes" }, `Force: ${what}`);
  const no = make("button", { type: "button", class: "force-no" }, "No");
  const asked = make("span", { hidden: "" }, "It is refused for the reason above. The limits of ", make("code", {}, "safety"), " stay. All the same? ", yes, " ", no);
  const open = (/** @type {boolean} */ shown) => {
    asked.hidden = !shown;
    ask.hidden = shown;
    if (shown) no.focus();
  };
  ask.addEventListener("click", () => open(true));
  no.addEventListener("click", () => open(false));
  yes.addEventListener("click", force);
  questions.set(place, () => open(false));
  return make("p", { class: "question" }, ask, asked);
}
