// One-line notices at the edge of the page: what went wrong and what to do, or what was done and how to undo it.

import { Refusal } from "./api.js";
import { byId, make } from "./dom.js";

const SHOWN_MS = 12000;

/**
 * @param {string} text
 * @param {object} [more]
 * @param {string} [more.remedy]
 * @param {"good" | "bad" | ""} [more.tone]
 * @param {{ label: string, act: () => void }} [more.action]
 */
export function notice(text, { remedy = "", tone = "", action } = {}) {
  const close = make("button", { type: "button", class: "plain", "aria-label": `Close: ${text}`, onclick: () => shown.remove() }, "Close");
  const act = action && make("button", { type: "button", onclick: () => (shown.remove(), action.act()) }, action.label);
  const shown = make("div", { class: `notice ${tone}` }, make("p", {}, text, remedy && make("small", {}, remedy)), act, close);
  const host = byId("notices");
  host.append(shown);
  while (host.children.length > 4) host.firstElementChild?.remove();
  setTimeout(() => shown.matches(":hover, :focus-within") || shown.remove(), SHOWN_MS);
}

/** Tell an error; what was given up on purpose is none. @param {unknown} error */
export function complain(error) {
  if (error instanceof DOMException && error.name === "AbortError") return;
  if (error instanceof Refusal) notice(error.message, { remedy: error.remedy, tone: "bad" });
  else {
    notice(error instanceof Error ? error.message : String(error), { tone: "bad" });
    throw error;
  }
}

/**
 * A listener that does something with the service, one at a time, and tells what went wrong.
 *
 * @param {() => Promise<unknown>} act
 * @returns {(event: Event) => Promise<void>}
 */
export function doing(act) {
  let busy = false;
  return async (event) => {
    event.preventDefault();
    if (busy) return;
    busy = true;
    try {
      await act();
    } catch (error) {
      complain(error);
    } finally {
      busy = false;
    }
  };
}
