// The right to read one path without the token, for a minute: what a frame or a download needs, as neither sends a header.

import { send } from "./api.js";

/** @param {string} path below /api/runs/ @returns {Promise<string>} the address to open */
export async function ticketFor(path) {
  return (await send("POST", "/api/ticket", { path })).url;
}
