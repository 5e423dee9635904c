// Voltages of the trim electrodes, of their full scale.

import { byId, say } from "./dom.js";

/** @param {Record<string, { volts: number, most_V: number }> | undefined} trims voltages of the trim outputs, by name */
export function showTrims(trims) {
  const host = byId("trims");
  host.hidden = !trims;
  if (!trims) return;
  say(host, `Trim: ${Object.entries(trims).map(([name, one]) => `${name} ${one.volts.toFixed(3)} of ${one.most_V.toPrecision(3)} V`).join(", ")}`);
}
