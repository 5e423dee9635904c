// The run that ended last, for a page that was loaded after it: what the service heard at its end, and its record.

import { get, getBytes, query } from "./api.js";
import { showDrive } from "./drive.js";
import { decode } from "./frame.js";

const PERIODS = 3;
const INNOVATION_S = 10;
const POINTS = 400;

/** @typedef {import("./board.js").RunNow} RunNow */

/**
 * @param {import("./bench.js").Bench} bench
 * @param {string} run
 * @param {RunNow | null} ended what the loop said of itself last; null where this service was not there
 * @param {() => boolean} wanted whether no other run has begun meanwhile
 */
export async function showLast(bench, run, ended, wanted) {
  const row = await get(`/api/runs/${encodeURIComponent(run)}`);
  const end = ended?.t_s ?? row.seconds;
  if (!wanted() || !end) return;
  const told = async () => {
    if (!ended || !wanted()) return;
    bench.motion.set(ended);
    bench.estimates.drawn = 0;
    bench.estimates.set(ended);
    bench.innovation.set(ended);
    showDrive(/** @type {any} */ (ended).drive);
  };
  await told(); // at once: the estimates are known by name then
  const part = async (/** @type {string[]} */ channels, /** @type {number} */ from, /** @type {number} */ points) => decode(await getBytes(`/api/runs/${encodeURIComponent(run)}/series${query({ channels: channels.join(), from: Math.max(0, from), to: end, points })}`));
  await bench.motion.recall(run);
  if (!ended && wanted()) bench.motion.last();
  await bench.estimates.recall(run, end);
  await told(); // with their courses
  if (wanted()) bench.motion.draw();
  const innovation = await part(["innovation.nu_x_V", "innovation.nu_y_V"], end - INNOVATION_S, POINTS).catch(() => null);
  if (innovation && wanted()) bench.innovation.take(innovation);
  const stiffness = ended?.estimates?.kxx_per_s2?.[0] ?? row.figures?.kxx?.value;
  if (stiffness && stiffness > 0) {
    const pattern = await part(["capture.vx_V", "capture.vy_V"], end - (PERIODS * 2 * Math.PI) / Math.sqrt(stiffness), 20000).catch(() => null);
    if (pattern && wanted()) bench.pattern.take(pattern);
  }
  if (wanted()) await bench.scope.last(run, end, wanted);
}
