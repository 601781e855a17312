// What the page asks the daemon for, and how each control says what became of it.
// @ts-check

import { byId, number, say } from "./dom.js";
import { ask } from "./link.js";
import { showRefusal } from "./refusal.js";

/**
 * Run a command and say at its place how it went.
 * @param {string} name @param {any} body @param {string} place
 * @param {(answer: any) => void} [done] also after it was forced
 * @param {(error: unknown) => boolean} [placed] whether a refusal has found a better place
 * @param {(remedy: import("./refusal.js").Remedy) => unknown} [apply]
 */
export async function command(name, body, place, done = () => {}, placed = () => false, apply = bringAbout) {
  const send = async (/** @type {any} */ asked) => {
    const answer = await ask(name, asked);
    say(place, "");
    done(answer);
  };
  try {
    await send(body);
  } catch (error) {
    if (placed(error)) return;
    showRefusal(byId(place), error, {
      what: name,
      apply: async (remedy) => {
        await apply(remedy);
        say(place, `${remedy.key} is ${number(remedy.after, 6)} ${remedy.unit}; ${name} tries again`);
      },
      force: () => send({ ...body, force: true }),
    });
  }
}

/** @param {import("./refusal.js").Remedy} remedy of the settings */
export function bringAbout(remedy) {
  return remedy.key === "spring.origin" ? ask("origin", { force: false }) : ask("set", { settings: { [remedy.key]: remedy.after }, force: false });
}

/**
 * The buttons that are one command each.
 * @param {import("./view.js").View} view
 * @param {(lease: any) => void} showLease
 */
export function connectCommands(view, showLease) {
  // A pressed button lets the focus go: the next press on the space bar holds the trace, and moves nothing.
  document.addEventListener("click", (event) => {
    const button = /** @type {HTMLElement} */ (event.target).closest("button:not([role=tab]), input[type=checkbox]");
    if (button && (event.detail > 0 || button.closest(".commands"))) /** @type {HTMLElement} */ (button).blur();
  });
  const click = (/** @type {string} */ id, /** @type {() => void} */ act) => byId(id).addEventListener("click", act);
  // what the button said, and the second click of a double click says nothing more
  const meant = (/** @type {string} */ id, /** @type {(value: string) => void} */ act) =>
    byId(id, HTMLButtonElement).addEventListener("click", ({ detail }) => detail < 2 && act(byId(id, HTMLButtonElement).value));
  click("start", () => {
    view.roll();
    command("start", { force: false }, "command-answer");
  });
  click("clear", () => command("clear", {}, "command-answer"));
  meant("record", (value) => command("record", { on: value === "start" }, "command-answer"));
  click("origin", () =>
    command("origin", { force: false }, "command-answer", (answer) =>
      say("command-answer", `spring.origin = ${number(answer.applied["spring.origin"], 6)} ${view.live.units.position}, where the shaft is`),
    ),
  );
  meant("take", (value) => command("lease", { take: value === "take" }, "command-answer", (answer) => showLease({ ...answer, may: true })));
}
