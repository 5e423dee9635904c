// SAFE: one press, from everywhere on the page, in every state. It goes out on the connection that is open already; where
// there is none, or no answer comes, by a request.

import { send } from "./api.js";
import { byId } from "./dom.js";
import { notice } from "./notices.js";

/** @typedef {import("./live.js").Live} Live */
/** @typedef {{ confirmed: boolean | null, words?: string }} Said whether the board has said that it is SAFE; null where nobody asked one */

const ANSWER_MS = 2500; // the service itself waits two seconds for the board

/** @param {Live} live */
export function watchSafe(live) {
  const button = byId("safe", HTMLButtonElement);
  /** @type {((said: Said) => void) | null} */
  let answered = null;
  live.on("safe", (said) => answered?.(said));

  /** @returns {Promise<Said | null>} null where nothing answered */
  const overLive = () =>
    new Promise((resolve) => {
      if (!live.say({ op: "safe" })) return resolve(null);
      answered = resolve;
      return setTimeout(resolve, ANSWER_MS, null);
    });

  const press = async () => {
    const asked = overLive(); // before anything is drawn
    button.dataset.sent = "yes";
    setTimeout(() => delete button.dataset.sent, 600);
    try {
      const said = /** @type {Said} */ ((await asked) ?? (await send("POST", "/api/board/safe")));
      if (said.confirmed === false) notice(said.words || "the board has not said SAFE yet", { remedy: "if it still drives, cut the supply", tone: "bad" });
    } catch (error) {
      const { message, remedy = "" } = /** @type {import("./api.js").Refusal} */ (error);
      if (live.up) notice(message, { remedy, tone: "bad" });
      else notice(`SAFE was not sent: ${message}`, { remedy: "the board's watchdog stops it when the host stops sending; if it still drives, cut the supply", tone: "bad" });
    }
  };
  button.addEventListener("click", press);
  // while it is captured: nothing on the page can keep the key from it
  window.addEventListener("keydown", (event) => event.key === "Escape" && !event.repeat && press(), { capture: true });
}
