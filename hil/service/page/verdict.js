// A verdict in words and tone, the same as in the reports.

import { make } from "./dom.js";
import { uncertain } from "./numbers.js";

/** @typedef {{ outcome: string, reason?: string, next?: string | null }} Part */

const TONES = /** @type {Record<string, "good" | "bad" | "slow">} */ ({
  good: "good", complete: "good", adequate: "good", explained: "good",
  failed: "bad", unsafe: "bad", unexplained: "bad",
  lacks: "slow", interrupted: "slow", "partly explained": "slow",
});

/** @param {string | null | undefined} verdict @returns {"good" | "bad" | "slow" | ""} */
export const toneOf = (verdict) => TONES[verdict ?? ""] ?? "";

/** @param {string | null | undefined} verdict @returns {HTMLElement} */
export const word = (verdict) => make("span", { class: `word ${toneOf(verdict)}` }, verdict || "–");

/**
 * The verdict of a run with the parts that speak against it, and why where there is room.
 *
 * @param {{ verdict?: string | null, state?: string, against?: Record<string, string> }} row
 * @param {{ reasons?: boolean }} [how]
 */
export function verdictOf({ verdict, state, against }, { reasons = false } = {}) {
  const parts = Object.entries(against ?? {});
  if (!parts.length) return word(verdict ?? state);
  const told = parts.map(([part, reason]) => (reasons && reason ? `${part}: ${reason}` : part)).join(reasons ? "; " : ", ");
  const whole = parts.map(([part, reason]) => `${part}: ${reason}`).join("\n");
  return make("span", { title: whole }, word(verdict ?? state), ` ${told}`);
}

/** The parts of a run's verdict, the worst of which is the verdict. @param {Record<string, Part | string> | null | undefined} parts */
export function partsOf(parts) {
  const whole = Object.entries(parts ?? {}).map(([name, part]) => /** @type {[string, Part]} */ ([name, typeof part === "string" ? { outcome: part } : part]));
  const rows = whole.map(([name, part]) =>
    make("div", { class: toneOf(part.outcome) }, make("dt", {}, name), make("dd", {}, make("b", {}, part.outcome), beside(part))));
  return make("dl", { class: "parts" }, ...rows);
}

/** The reason as it reads after the outcome, whose word it need not say again. @param {Part} part */
const beside = ({ outcome, reason = "" }) => (reason.startsWith(`${outcome} `) ? reason.slice(outcome.length + 1) : reason);

/** What a trace found: effects with their coefficients and 95 % intervals. @param {any} diagnosis @returns {HTMLElement[]} */
export function effectsOf(diagnosis) {
  return (diagnosis.effects ?? []).map((/** @type {any} */ effect) =>
    make("p", {}, make("b", {}, effect.name.replaceAll("_", " ")), ": ", Object.entries(effect.coefficients ?? {}).map(([symbol, one]) => coefficient(symbol, one)).join(", ")));
}

/** @param {string} symbol @param {any} one with value, ci95, unit */
function coefficient(symbol, one) {
  const half = one.ci95?.[0] === null || one.ci95?.[1] === null || !one.ci95 ? null : (one.ci95[1] - one.ci95[0]) / 2;
  const written = uncertain(one.value, half, one.unit ?? "");
  const value = `${written.value}${written.spread ? ` ± ${written.spread}` : ""}`;
  return `${symbol} = ${written.unit.startsWith("×") ? `(${value})` : value} ${written.unit}`.trim();
}
