// Names and units of the figures of a run, as the page writes them. A figure that is not listed keeps its own name.

import { count, quantity } from "./numbers.js";

/** @type {Record<string, string>} */
const NAMES = {
  angle_error_rms_rad: "angle error, rms",
  rate_error_rms_rad_s: "rate error, rms",
  angle_u_rad: "angle uncertainty u (k = 1)",
  angle_expanded_rad: "angle uncertainty U (k = 2)",
  angle_rad: "angle at the end",
  innovation_rms: "innovation, rms",
  noise_floor: "noise floor",
  residual_ratio: "residual over noise floor",
  ratio_before: "residual over noise floor, before",
  ratio_after: "residual over noise floor, after",
  seconds: "length",
  samples: "samples",
  late: "late answers",
  lost: "lost samples",
  answered_fraction: "answered in time",
  angle_per_rotation: "angle per rotation",
  control_imperfection_rms_rad: "control imperfection, rms",
};

const SUFFIXES = /** @type {const} */ ([
  ["_rad_s", "rad/s"], ["_rad", "rad"], ["_us", "µs"], ["_ns", "ns"], ["_s", "s"], ["_V", "V"], ["_Hz", "Hz"], ["_m", "m"], ["_ppm", "ppm"],
]);

/** @param {string} name of a figure, dots between its parts @returns {string} */
export function nameOf(name) {
  const suffix = SUFFIXES.find(([ending]) => name.endsWith(ending))?.[0] ?? "";
  return NAMES[name] ?? name.slice(0, name.length - suffix.length).replaceAll(".", " · ").replaceAll("_", " ");
}

/** @param {string} name @param {string | null} [unit] as the service says @returns {string} */
export function unitOf(name, unit) {
  if (unit) return unit === "1" ? "" : unit;
  if (name === "innovation_rms" || name === "noise_floor") return "V";
  if (name === "seconds") return "s";
  return SUFFIXES.find(([suffix]) => name.endsWith(suffix))?.[1] ?? "";
}

/** @param {string} name @param {unknown} value @param {string | null} [unit] @returns {string} */
export function figure(name, value, unit) {
  if (typeof value === "number") return Number.isInteger(value) && !unitOf(name, unit) ? count(value) : quantity(value, unitOf(name, unit), 4);
  if (value === null || value === undefined) return "–";
  return String(value);
}
