// The estimates of the observer: value with expanded uncertainty, and the course of both over the last minute.

import { cleared, sizeOf } from "./canvas.js";
import { byId, colour, fill, make, say } from "./dom.js";
import { History } from "./history.js";
import { uncertain } from "./numbers.js";
import { recall } from "./recall.js";

const COURSE_S = 60;
const MOVING = new Set(["x_m", "y_m", "vx_mps", "vy_mps"]);

/** @type {Record<string, [string, string]>} symbol and its index */
const SYMBOLS = {
  x_m: ["x", ""], y_m: ["y", ""], vx_mps: ["ẋ", ""], vy_mps: ["ẏ", ""], rate_rad_s: ["Ω", ""],
  phi_x_V: ["Φ", "x"], phi_y_V: ["Φ", "y"],
};

/** @param {string} name of a column, e.g. kxx_per_s2 @returns {[string, string]} */
function symbolOf(name) {
  if (SYMBOLS[name]) return SYMBOLS[name];
  const [stem] = name.split("_");
  return [stem.slice(0, 1), stem.slice(1)];
}

export class EstimatesTable {
  constructor() {
    this.table = byId("estimates", HTMLTableElement);
    this.history = new History(COURSE_S);
    /** @type {Map<string, { value: HTMLElement, spread: HTMLElement, unit: HTMLElement, course: HTMLCanvasElement }>} */
    this.rows = new Map();
    this.drawn = 0;
  }

  /** What was recorded in the last minute. @param {string} run @param {number} t_s bench time now */
  async recall(run, t_s) {
    const names = [...this.rows.keys()];
    if (!names.length) return;
    this.history.clear();
    const { t, values } = await recall(run, names.flatMap((name) => [`estimates.${name}`, `estimates.sd_${name}`]), Math.max(0, t_s - COURSE_S), 2 * COURSE_S);
    this.history.recall(t, Object.fromEntries(names.flatMap((name, i) => [[name, values[2 * i]], [`sd ${name}`, values[2 * i + 1]]])));
  }

  /** @param {import("./board.js").RunNow | null} run the last estimates stay where there is none */
  set(run) {
    const estimates = run?.estimates ?? {};
    const names = Object.keys(estimates);
    byId("estimates-none").hidden = names.length > 0 || this.rows.size > 0;
    this.table.hidden = names.length === 0 && this.rows.size === 0;
    if (!run || !names.length) return;
    if (names.join() !== [...this.rows.keys()].join()) this.layOut(names);
    this.history.add(run.t_s, Object.fromEntries(names.flatMap((name) => [[name, estimates[name][0]], [`sd ${name}`, estimates[name][1]]])));
    const now = performance.now();
    if (now - this.drawn < 240 || sizeOf(this.table).width === 0) return;
    this.drawn = now;
    for (const [name, row] of this.rows) {
      const [value, sd, unit] = estimates[name];
      const written = uncertain(value, sd && 2 * sd, unit);
      say(row.value, written.value);
      say(row.spread, written.spread && `± ${written.spread}`);
      say(row.unit, written.unit);
      if (!MOVING.has(name)) this.course(row.course, name);
    }
  }

  /** @param {string[]} names */
  layOut(names) {
    this.rows.clear();
    this.history.clear();
    const rows = names.map((name) => {
      const row = { value: make("td", { class: "n" }), spread: make("span", { class: "pm" }), unit: make("span", { class: "unit" }), course: make("canvas", { "aria-hidden": "true" }) };
      this.rows.set(name, row);
      const [symbol, index] = symbolOf(name);
      return make("tr", {}, make("th", { scope: "row", title: name }, make("i", {}, symbol), index && make("sub", {}, index)), row.value, make("td", { class: "after" }, row.spread, " ", row.unit), make("td", { class: "course" }, MOVING.has(name) ? "" : row.course));
    });
    fill(this.table.tBodies[0], ...rows);
  }

  /** @param {HTMLCanvasElement} canvas @param {string} name */
  course(canvas, name) {
    const sheet = cleared(canvas);
    if (!sheet) return;
    const { ink, width, height } = sheet;
    const { t } = this.history;
    const [values, spreads] = [this.history.values[name], this.history.values[`sd ${name}`]];
    const end = t[t.length - 1];
    // the axis fits the later half: the first seconds of a run settle from far away
    let [low, high] = [Infinity, -Infinity];
    for (let i = t.length >> 1; i < t.length; i += 1) {
      const [value, sd] = [values[i], spreads[i]];
      if (value === null) continue;
      low = Math.min(low, value - 3 * (sd ?? 0));
      high = Math.max(high, value + 3 * (sd ?? 0));
    }
    if (!(high > low)) [low, high] = [low - 1, low + 1];
    const x = (/** @type {number} */ i) => width - ((end - t[i]) / Math.max(Math.min(COURSE_S, end - t[0]), 1)) * width;
    const y = (/** @type {number} */ value) => Math.max(-4, Math.min(height + 4, height - 1 - ((value - low) / (high - low)) * (height - 2)));
    ink.fillStyle = `${colour("--first")}38`;
    ink.beginPath();
    for (let i = 0; i < t.length; i += 1) if (values[i] !== null) ink.lineTo(x(i), y(/** @type {number} */ (values[i]) + 2 * (spreads[i] ?? 0)));
    for (let i = t.length - 1; i >= 0; i -= 1) if (values[i] !== null) ink.lineTo(x(i), y(/** @type {number} */ (values[i]) - 2 * (spreads[i] ?? 0)));
    ink.fill();
    ink.strokeStyle = colour("--first");
    ink.lineWidth = 1.2;
    ink.beginPath();
    for (let i = 0; i < t.length; i += 1) if (values[i] !== null) ink.lineTo(x(i), y(/** @type {number} */ (values[i])));
    ink.stroke();
  }
}
