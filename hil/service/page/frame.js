// A binary frame of samples, live or recorded: 40 bytes of header, then per channel the least and greatest value of
// each bucket. A bucket of one sample has both equal; one in which nothing was recorded has NaN.

const HEADER = 40;
const MAGIC = 0x31545947; // "GYT1", little-endian

/**
 * @typedef {object} Frame
 * @property {number} id of the subscription
 * @property {number} buckets
 * @property {number} t0 bench time of the first bucket, s
 * @property {number} dt seconds per bucket
 * @property {number} serial of the first bucket
 * @property {{ min: Float64Array, max: Float64Array }[]} channels
 */

/**
 * @param {ArrayBuffer} bytes
 * @returns {Frame}
 * @throws {Error} where they are no frame
 */
export function decode(bytes) {
  const view = new DataView(bytes);
  if (bytes.byteLength < HEADER || view.getUint32(0, true) !== MAGIC) throw new Error("not a frame of samples");
  const count = view.getUint32(8, true);
  const buckets = view.getUint32(12, true);
  if (bytes.byteLength < HEADER + 8 * count * buckets) throw new Error("a frame of samples that is cut short");
  const channels = [];
  for (let channel = 0; channel < count; channel += 1) {
    const pairs = new Float32Array(bytes, HEADER + 8 * channel * buckets, 2 * buckets);
    const min = new Float64Array(buckets);
    const max = new Float64Array(buckets);
    for (let bucket = 0; bucket < buckets; bucket += 1) {
      min[bucket] = pairs[2 * bucket];
      max[bucket] = pairs[2 * bucket + 1];
    }
    channels.push({ min, max });
  }
  return {
    id: view.getUint32(4, true),
    buckets,
    t0: view.getFloat64(16, true),
    dt: view.getFloat64(24, true),
    serial: Number(view.getBigUint64(32, true)),
    channels,
  };
}

/** @param {Frame} frame @returns {Float64Array} bench time of each bucket, s */
export function times(frame) {
  return Float64Array.from({ length: frame.buckets }, (_, bucket) => frame.t0 + bucket * frame.dt);
}
