// Angle and rate: the newest value with its expanded uncertainty, and the course of both with a reference where there is one.

import { Chart } from "./chart.js";
import { byId, say } from "./dom.js";
import { History } from "./history.js";
import { turns, uncertain } from "./numbers.js";
import { recall } from "./recall.js";

/** @typedef {import("./board.js").RunNow} RunNow */

const LONGEST_S = 600;

export class Motion {
  constructor() {
    this.history = new History(LONGEST_S);
    this.span = byId("span", HTMLSelectElement);
    /** @param {string} name @param {string} unit @param {string} label */
    const chart = (name, unit, label) =>
      new Chart(byId(`${name}-chart`), {
        label,
        y: unit,
        sync: "motion",
        lines: [
          { label: name, colour: "--first", kind: "band" },
          { label: "reference", colour: "--second", kind: "plain", dashed: true },
        ],
      });
    this.angle = chart("angle", "rad", "Course of the angle with its uncertainty");
    this.rate = chart("rate", "rad/s", "Course of the rate with its uncertainty");
    this.span.addEventListener("change", () => this.draw());
    this.drawn = 0;
  }

  /** @param {string} run that lasts */
  async recall(run) {
    this.history.clear();
    const { t, values } = await recall(run, ["estimates.angle_rad", "estimates.angle_u_rad", "estimates.rate_rad_s", "estimates.sd_rate_rad_s"], 0, LONGEST_S);
    this.history.recall(t, { angle: values[0], angleU: values[1], rate: values[2], rateU: values[3] });
  }

  /** The end of what was recalled: where nobody knows any more what the loop said last. */
  last() {
    const { t, values } = this.history;
    const [angle, u, rate, rateU] = ["angle", "angleU", "rate", "rateU"].map((name) => values[name]?.at(-1) ?? null);
    if (t.length) this.set({ t_s: t[t.length - 1], elapsed_s: 0, angle_rad: angle, angle_u_rad: u, angle_expanded_rad: u && 2 * u, rate_rad_s: rate, rate_u: rateU });
  }

  /** @param {RunNow | null} run */
  set(run) {
    if (!run) return;
    const more = /** @type {any} */ (run);
    const { angle_rad: angle, angle_u_rad: angleU, angle_expanded_rad: expanded, rate_rad_s: rate, rate_u: rateU } = run;
    const before = expanded ? " before the closing scan" : ""; // which puts what the record leaves in the place of what is declared
    reading("angle", angle, expanded, "rad", angle === null || angle === undefined ? "" : `${before}, ${turns(angle)}`);
    reading("rate", rate, rateU && 2 * rateU, "rad/s", "");
    this.history.add(run.t_s, { angle, angleU, rate, rateU, angleReference: more.reference?.angle_rad ?? more.angle_reference_rad, rateReference: more.reference?.rate_rad_s ?? more.rate_reference_rad_s });
    const now = performance.now();
    if (now - this.drawn < 95) return;
    this.drawn = now;
    this.draw();
  }

  draw() {
    const { t, values } = this.history;
    if (!t.length || !values.angle) return;
    const span = Number(this.span.value);
    const end = t[t.length - 1];
    let first = 0;
    while (t[first] < end - span) first += 1;
    const [x, cut] = [t.slice(first), (/** @type {string} */ name) => (values[name] ?? []).slice(first)];
    for (const [chart, name] of /** @type {const} */ ([[this.angle, "angle"], [this.rate, "rate"]])) {
      const [mid, u] = [cut(name), cut(`${name}U`)];
      const edge = (/** @type {number} */ sign) => mid.map((value, i) => (value === null ? null : value + sign * 2 * (u[i] ?? 0)));
      chart.set(x, [{ mid, low: edge(-1), high: edge(1) }, { mid: cut(`${name}Reference`) }], [Math.max(t[0], end - span), Math.max(end, t[0] + 1)]);
    }
  }
}

/** @param {"angle" | "rate"} name @param {number | null | undefined} value @param {number | null | undefined} spread @param {string} unit @param {string} more */
function reading(name, value, spread, unit, more) {
  const written = uncertain(value, spread, unit, { prefix: false });
  say(byId(`${name}-value`), written.value);
  say(byId(`${name}-spread`), value === null || value === undefined ? "" : `${written.spread && `± ${written.spread} `}${written.unit}${more}${spread ? "" : ", uncertainty not given"}`);
}
