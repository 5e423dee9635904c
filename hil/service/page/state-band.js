// The board's state in words, and why it is SAFE. What nobody asked for is an alarm.

import { get } from "./api.js";
import { byId, say } from "./dom.js";

/** @typedef {import("./board.js").Board} Board */

const REASONS = /** @type {Record<string, [string, string]>} */ ({
  HOST_REQUEST: ["run finished, drive off", ""],
  INTERRUPTED: ["stopped by the operator", ""],
  RESIDUAL: ["the innovation exceeded its limit", "Look at the run's report before you arm it again."],
  WATCHDOG: ["the host stopped sending, and the board's watchdog stopped the drive", "Check the link and the load of this machine."],
  LINK_LOST: ["no more samples arrived", "Check the cable and the supply, then connect again."],
  FAULT: ["the board's own protection tripped", "Check the board. It clears FAULT itself when the fault is gone."],
});
const CALM = new Set(["", "NONE", "HOST_REQUEST", "INTERRUPTED"]);

const STATES = /** @type {Record<string, [string, string]>} */ ({
  BOOT: ["off", "powered up, no HELLO yet"],
  IDLE: ["off", "no force, not armed"],
  ARMED: ["armed", "armed, not driven yet"],
  RUNNING: ["run", ""],
});

/** @param {Board} board @param {boolean} up @param {string} refused @param {any} last the row of the run that ended last @returns {{ tone: string, word: string, reason: string, next: string }} */
export function inWords(board, up, refused, last) {
  if (refused) return { tone: "alarm", word: "No access", reason: refused, next: "Open the address that hil serve prints; it has the token." };
  if (!up) return { tone: "alarm", word: "Service lost", reason: "the bench service does not answer", next: "The loop and the board's watchdog do not need it. Start it again with hil serve; this page connects by itself." };
  const safety = board.running ? "" : last?.parts?.safety;
  if (safety === "unsafe") return { tone: "alarm", word: "Not confirmed", reason: last.reasons[0] ?? "the board has not said that it is SAFE", next: "Cut the supply." };
  if (board.left) return { tone: "off", word: "Run ended", reason: board.words, next: "" };
  if (board.lost) return { tone: "alarm", word: "Board lost", reason: board.words || "it does not answer", next: "Check the cable and the supply. Its watchdog has stopped the drive; it is connected again as soon as it answers." };
  if (!board.connected) return { tone: "off", word: "No board", reason: board.words || "choose a bench file and connect", next: "" };
  if (board.state === "SAFE") {
    if (safety === "failed") return { tone: "alarm", word: "SAFE", reason: last.reasons[0] ?? sentence(board), next: "Look at the run's report before you arm it again." };
    // a board that nobody drives is asked for its state by a SAFE for LINK_LOST, which then is its reason
    if (board.reason === "LINK_LOST") return { tone: "safe", word: "SAFE", reason: "held by the host, nothing is armed", next: "" };
    return { tone: CALM.has(board.reason) ? "safe" : "alarm", word: "SAFE", reason: sentence(board), next: REASONS[board.reason]?.[1] ?? "" };
  }
  const [tone, reason] = STATES[board.state] ?? ["off", ""];
  return { tone, word: board.state || "connected", reason: reason || [board.bench, board.link].filter(Boolean).join(" on "), next: board.words };
}

/** @param {Board} board */
function sentence(board) {
  const known = REASONS[board.reason]?.[0];
  return known ? `${board.reason}: ${known}` : board.reason;
}

/** @param {import("./board.js").BoardState} state @param {import("./live.js").Live} live */
export function watchState(state, live) {
  const band = byId("state");
  /** @type {any} */
  let last = null;
  const draw = () => {
    const { now, up } = state;
    const { tone, word, reason, next } = inWords(now, up, live.refused, now.lastRun && last?.id === now.lastRun ? last : null);
    if (band.dataset.tone !== tone) band.dataset.tone = tone;
    say(byId("state-word"), word);
    say(byId("state-reason"), reason);
    say(byId("state-next"), next);
    byId("state-next").hidden = !next;
  };
  const learn = (/** @type {any} */ row) => {
    last = row;
    draw();
  };
  state.listen((board, up, before) => {
    // of a run that ended before this page looked; of others the service tells
    if (up && board.lastRun && !before.connected && last?.id !== board.lastRun) get(`/api/runs/${encodeURIComponent(board.lastRun)}`).then(learn, () => null);
    draw();
  });
  live.on("run", (row) => row.verdict && learn(row));
  live.on("service", ({ up, refused }) => {
    byId("service").dataset.up = up ? "yes" : "no";
    say(byId("service-text"), up ? "service connected" : refused ? "no access" : "service lost");
  });
}
