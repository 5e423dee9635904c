// Consent to arming: what is on the other end of a wire may move, so a person says yes to it once per run.

import { byId, fill, make, say } from "./dom.js";

/**
 * Ask; the answer "no" has the focus.
 *
 * @param {string} board what would be armed, by its link
 * @param {[string, string][]} facts what the person consents to
 * @returns {Promise<boolean>}
 */
export function askConsent(board, facts) {
  const dialog = byId("consent", HTMLDialogElement);
  say(byId("consent-title"), `Arm ${board}?`);
  say(byId("consent-text"), "The board will drive what is connected to it. It may move, heat or break. SAFE, or the key Escape, stops it at any time.");
  fill(byId("consent-facts"), ...facts.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "yes"), { once: true });
  });
}
