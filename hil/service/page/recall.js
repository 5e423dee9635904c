// What a run recorded before this page looked: so that its curves begin with the run, not with the page.

import { getBytes, query } from "./api.js";
import { decode, times } from "./frame.js";

/**
 * @param {string} run
 * @param {string[]} channels
 * @param {number} from bench time, s
 * @param {number} points
 * @returns {Promise<{ t: number[], values: (number | null)[][] }>} the middle of each stretch
 */
export async function recall(run, channels, from, points) {
  const frame = decode(await getBytes(`/api/runs/${encodeURIComponent(run)}/series${query({ channels: channels.join(), from, points })}`));
  const middle = (/** @type {number} */ low, /** @type {number} */ high) => (Number.isNaN(low) ? null : (low + high) / 2);
  return { t: [...times(frame)], values: frame.channels.map(({ min, max }) => Array.from(min, (low, i) => middle(low, max[i]))) };
}
