// The lease of the board: who drives it says so, for a while at a time. A page that is closed or hangs loses it by itself.

import { currentLease, send, useLease } from "./api.js";
import { holder } from "./session.js";

const SECONDS = 15;
const RENEW_MS = 4000;

let renewing = 0;

/** Take the lease, or keep the one there is. Throws a Refusal that names the holder where somebody else has it. */
export async function takeLease() {
  if (currentLease() && (await renew())) return;
  const answer = await send("POST", "/api/lease", { holder: holder(), purpose: "bench page", seconds: SECONDS });
  keep(answer.lease);
}

/** Give it back. */
export async function giveLeaseBack() {
  if (!currentLease()) return;
  await send("DELETE", "/api/lease").catch(() => null);
  keep(null);
}

/** Have the lease end with the page: at once where it is closed well, else within its seconds. */
export function endLeaseWithPage() {
  addEventListener("pagehide", () => {
    if (currentLease()) send("DELETE", "/api/lease", undefined, { keepalive: true }).catch(() => null);
  });
  addEventListener("pageshow", (event) => event.persisted && keep(null)); // it came back out of the browser's cache
}

/** @returns {Promise<boolean>} whether it is still ours */
async function renew() {
  try {
    await send("PUT", "/api/lease", { seconds: SECONDS });
    return true;
  } catch (error) {
    const status = /** @type {any} */ (error).status;
    if (status >= 400) keep(null); // where nobody answers it may still stand
    return false;
  }
}

/** @param {string | null} lease */
function keep(lease) {
  useLease(lease);
  clearInterval(renewing);
  if (lease) renewing = setInterval(renew, RENEW_MS);
}
