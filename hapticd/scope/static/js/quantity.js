// Fields for numbers. What is typed goes to the server as it stands, which reads it as the command line does; what it cannot
// read is refused at the field. Nothing is sent but by Enter, or by the button of the form that the field is in, and a
// stop, or whoever leaves the field, takes back what was not sent.
// @ts-check

import { Refusal } from "./link.js";

/** @typedef {{text: string, unit: string}} Quantity */

/** @type {Set<Field>} */
const fields = new Set();

export class Field {
  /**
   * @param {HTMLInputElement} input
   * @param {() => string} unit of a number without one, as it is written beside the field
   * @param {((said: Quantity) => Promise<unknown>) | null} send what Enter does; null: the field's form sends it
   * @param {HTMLElement} error where a refusal stands
   */
  constructor(input, unit, send, error) {
    this.input = input;
    this.unit = unit;
    /** What is in force. */
    this.settled = input.value;
    /** What is on its way to the daemon, so that it cannot be taken back; null: nothing. @type {string | null} */
    this.sent = null;
    this.error = error;
    /** Says more about a refusal than its message. @type {((error: unknown) => void) | null} */
    this.explain = null;
    input.setAttribute("aria-describedby", error.id);
    input.addEventListener("input", () => {
      this.refuse("");
      this.show();
    });
    if (send) {
      input.addEventListener("keydown", (event) => {
        if (event.key === "Enter") this.try(() => send(this.said()));
      });
      input.addEventListener("blur", () => this.withdraw());
    }
    fields.add(this);
  }

  /** @returns {Quantity} */
  said() {
    return { text: this.input.value, unit: this.unit() };
  }

  /** Send it; a refusal stands at the field. @param {() => Promise<unknown>} send */
  async try(send) {
    const said = (this.sent = this.input.value);
    try {
      await send();
      this.settled = said;
      this.refuse("");
    } catch (error) {
      this.refuse(error instanceof Error ? error.message : String(error));
      this.explain?.(error);
    }
    this.sent = null;
    if (document.activeElement !== this.input) this.withdraw();
    this.show();
  }

  /** What is in force now; what is being typed stays. @param {string} text */
  settle(text) {
    const typing = this.input.value !== this.settled;
    this.settled = text;
    if (!typing) this.input.value = text;
    this.show();
  }

  /** Put a text there as if it were typed. @param {string} text */
  propose(text) {
    this.input.value = text;
    this.input.dispatchEvent(new Event("input"));
  }

  /** Take back what was not sent. */
  withdraw() {
    this.input.value = this.sent ?? this.settled;
    this.show();
  }

  /** @param {string} why */
  refuse(why) {
    if (this.error.textContent !== why) this.error.textContent = why;
    this.input.setAttribute("aria-invalid", String(Boolean(why)));
  }

  show() {
    this.input.classList.toggle("unsent", this.input.value !== this.settled);
  }
}

/** After a stop nothing is left that a later Enter or a later click could send. */
export function withdrawAll() {
  for (const field of fields) {
    if (field.input.isConnected) field.withdraw();
    else fields.delete(field);
  }
  if (document.activeElement instanceof HTMLInputElement) document.activeElement.blur();
}

/**
 * Say a refusal at the fields it is about; whether it is about fields.
 * @param {unknown} error @param {Record<string, Field>} places
 */
export function refuseAt(error, places) {
  if (!(error instanceof Refusal) || error.code !== "quantity") return false;
  for (const { key, message } of error.problems) places[key]?.refuse(message);
  return true;
}
