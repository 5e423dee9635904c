// The newest window of a stream of frames, whether each frame brings the whole window or only what is new in it.

import { times } from "./frame.js";

/** @typedef {import("./frame.js").Frame} Frame */

export class Window {
  /** @param {number} spanS */
  constructor(spanS) {
    this.spanS = spanS;
    /** @type {Frame | null} */
    this.frame = null;
  }

  /** @param {Frame} frame @returns {Frame} all of the window */
  add(frame) {
    const before = this.frame;
    const follows = before && before.dt === frame.dt && before.channels.length === frame.channels.length && frame.serial >= before.serial && frame.serial <= before.serial + before.buckets;
    const whole = frame.buckets * frame.dt >= 0.98 * this.spanS;
    this.frame = follows && !whole ? this.joined(before, frame) : frame;
    return this.frame;
  }

  /** @param {Frame} before @param {Frame} frame */
  joined(before, frame) {
    const kept = frame.serial - before.serial;
    const most = Math.max(1, Math.ceil(this.spanS / frame.dt));
    const cut = Math.max(0, kept + frame.buckets - most);
    const join = (/** @type {Float64Array} */ old, /** @type {Float64Array} */ added) => {
      const all = new Float64Array(kept + frame.buckets - Math.min(cut, kept));
      const from = Math.min(cut, kept);
      all.set(old.subarray(from, kept));
      all.set(added, kept - from);
      return all;
    };
    const from = Math.min(cut, kept);
    const channels = frame.channels.map((channel, i) => ({ min: join(before.channels[i].min, channel.min), max: join(before.channels[i].max, channel.max) }));
    return { ...frame, buckets: channels[0]?.max.length ?? 0, serial: before.serial + from, t0: frame.t0 - (kept - from) * frame.dt, channels };
  }
}

/** @param {Frame} frame @returns {number} bench time of its last bucket */
export const endOf = (frame) => frame.t0 + (frame.buckets - 1) * frame.dt;

export { times };
