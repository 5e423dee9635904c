// How quantities are written: with their uncertainty, in a unit that needs no power of ten, never with digits that mean nothing.

const PREFIXES = /** @type {const} */ ([[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]]);
const TAKES_PREFIX = new Set(["V", "m", "s", "Hz", "rad", "m/s", "rad/s", "N", "V/√Hz"]);
const MINUS = "−";
const TURN = 2 * Math.PI;

/** @param {string} text @returns {string} with a minus sign as set in print */
const printed = (text) => text.replace("-", MINUS);

/**
 * A number with so many digits, without a power of ten as far as that goes.
 *
 * @param {number | null | undefined} value
 * @param {number} [digits] significant
 * @returns {string} "–" where there is none
 */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e7 || size < 1e-4) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return printed(`${mantissa} × 10${superscript(Number(power))}`);
  }
  const decimals = Math.max(0, Math.min(10, digits - 1 - Math.floor(Math.log10(size))));
  return printed(grouped(value.toFixed(decimals)));
}

/** @param {number | null | undefined} value @returns {string} of things that are counted */
export function count(value) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : printed(grouped(value.toFixed(0)));
}

/** @param {string} digits @returns {string} with thin spaces between thousands from five digits on */
function grouped(digits) {
  const [whole, rest] = digits.split(".");
  const spaced = whole.replace("-", "").length < 5 ? whole : whole.replace(/\B(?=(\d{3})+$)/g, "\u202f");
  return rest === undefined ? spaced : `${spaced}.${rest}`;
}

/** @param {number} power @returns {string} */
function superscript(power) {
  return [...String(power)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)])).join("");
}

/**
 * The factor and the unit in which a quantity of this size is best written.
 *
 * @param {number} size in `unit`
 * @param {string} unit
 * @returns {{ factor: number, unit: string }} value · factor is in the new unit
 */
export function scaled(size, unit) {
  if (!TAKES_PREFIX.has(unit) || !Number.isFinite(size) || size === 0) return { factor: 1, unit };
  for (const [value, prefix] of PREFIXES) {
    if (Math.abs(size) >= value * 0.9995) return { factor: 1 / value, unit: prefix + unit };
  }
  return { factor: 1, unit };
}

/**
 * A quantity with its unit.
 *
 * @param {number | null | undefined} value
 * @param {string} unit
 * @param {number} [digits]
 */
export function quantity(value, unit, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const { factor, unit: written } = scaled(value, unit);
  return `${number(value * factor, digits)}${written ? ` ${written}` : ""}`;
}

/**
 * Value and uncertainty in one unit; the uncertainty has two digits, and the value ends where it does.
 *
 * @param {number | null | undefined} value
 * @param {number | null | undefined} spread in the same unit, ≥ 0
 * @param {string} unit
 * @param {{ prefix?: boolean }} [how] whether the unit may become one with a prefix
 * @returns {{ value: string, spread: string, unit: string }}
 */
export function uncertain(value, spread, unit, { prefix = true } = {}) {
  if (value === null || value === undefined || !Number.isFinite(value)) return { value: "–", spread: "", unit };
  if (!spread || !Number.isFinite(spread)) {
    const best = prefix ? scaled(value, unit) : { factor: 1, unit };
    return { value: number(value * best.factor), spread: "", unit: best.unit };
  }
  const best = prefix ? scaled(Math.max(Math.abs(value), spread), unit) : { factor: 1, unit };
  let [v, s] = [value * best.factor, spread * best.factor];
  const size = Math.max(Math.abs(v), s);
  if (size >= 1e7 || size < 1e-3) {
    const power = Math.floor(Math.log10(size));
    v /= 10 ** power;
    s /= 10 ** power;
    const decimals = places(s);
    return { value: printed(v.toFixed(decimals)), spread: s.toFixed(decimals), unit: `× 10${superscript(power)} ${best.unit}`.trim() };
  }
  const decimals = places(s);
  return { value: printed(grouped(v.toFixed(decimals))), spread: grouped(s.toFixed(decimals)), unit: best.unit };
}

/** @param {number} spread @returns {number} decimals that give it two digits */
function places(spread) {
  return Math.max(0, Math.min(9, 1 - Math.floor(Math.log10(spread))));
}

/** @param {number | null | undefined} seconds @returns {string} for a person: 48 s, 3 min 20 s, 2 h 5 min */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  if (seconds < 10) return `${seconds.toFixed(seconds < 1 ? 2 : 1)} s`;
  if (seconds < 90) return `${Math.round(seconds)} s`;
  const whole = Math.round(seconds);
  if (whole < 5400) return `${Math.floor(whole / 60)} min${whole % 60 ? ` ${whole % 60} s` : ""}`;
  const minutes = Math.round(seconds / 60);
  return `${Math.floor(minutes / 60)} h${minutes % 60 ? ` ${minutes % 60} min` : ""}`;
}

/** @param {string | number | null | undefined} time ISO 8601, or seconds since 1970 @returns {string} local time, to the second */
export function moment(time) {
  if (time === null || time === undefined || time === "") return "–";
  const at = new Date(typeof time === "number" ? time * 1000 : time);
  if (Number.isNaN(at.getTime())) return String(time);
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  return `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
}

/** @param {number} rad @returns {string} in turns */
export function turns(rad) {
  return `${number(rad / TURN, 3)} turns`;
}
