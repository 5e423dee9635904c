// The ellipse that the mass follows, from samples of a few periods: its middle, half axes and orientation.

/**
 * @typedef {object} Ellipse
 * @property {number} x middle
 * @property {number} y
 * @property {number} long half axis
 * @property {number} short half axis
 * @property {number} angle of the long axis, rad, in (−π/2, π/2]
 */

/**
 * From mean and covariance: on an ellipse run through evenly in phase, the variance along an axis is half its square.
 *
 * @param {ArrayLike<number>} x
 * @param {ArrayLike<number>} y
 * @returns {Ellipse | null} null where there are too few samples
 */
export function ellipseOf(x, y) {
  let [count, meanX, meanY, xx, yy, xy] = [0, 0, 0, 0, 0, 0];
  for (let i = 0; i < x.length; i += 1) {
    if (!Number.isFinite(x[i]) || !Number.isFinite(y[i])) continue;
    count += 1;
    const [dx, dy] = [x[i] - meanX, y[i] - meanY];
    meanX += dx / count;
    meanY += dy / count;
    xx += dx * (x[i] - meanX);
    yy += dy * (y[i] - meanY);
    xy += dx * (y[i] - meanY);
  }
  if (count < 4) return null;
  const [a, b, c] = [xx / count, yy / count, xy / count];
  const middle = (a + b) / 2;
  const apart = Math.hypot((a - b) / 2, c);
  return {
    x: meanX,
    y: meanY,
    long: Math.sqrt(2 * (middle + apart)),
    short: Math.sqrt(2 * Math.max(0, middle - apart)),
    angle: 0.5 * Math.atan2(2 * c, a - b),
  };
}
