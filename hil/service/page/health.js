// Link and deadlines: whether samples come, whether answers are in time, what was lost.

import { byId, fill, make, say } from "./dom.js";
import { count, duration, number } from "./numbers.js";

/** @type {Record<string, string>} */
const NAMES = {
  in_time: "answered in time", late: "late answers", lost: "lost samples", turnaround_us: "turnaround", samples: "samples", held: "drive held", silent_s: "last sample before",
};

/** @type {Map<string, HTMLElement>} */
const cells = new Map();

/** @param {Record<string, any>} health @param {any} run */
export function showHealth(health, run) {
  /** @type {Record<string, [string, string]>} name → text, tone */
  const rows = {};
  const samples = run?.samples ?? health.samples;
  for (const [name, value] of Object.entries({ ...health, ...pick(run ?? {}, ["samples"]) })) {
    if (value === null || typeof value === "boolean") continue;
    if (name === "silent_s" && !(run && value > 0.5)) continue; // samples come, or nobody waits for any
    if (name === "turnaround_us" && typeof value === "object") rows[name] = [["p50", "p99", "max"].filter((p) => p in value).map((p) => `${p} ${number(value[p], 3)}`).join(", ") + " µs", ""];
    else if (name === "in_time" && value <= 1) rows[name] = [`${(100 * value).toFixed(value > 0.999 ? 3 : 2)} %`, ""];
    else if (name.endsWith("_s")) rows[name] = [duration(value), ""];
    else if ((name === "late" || name === "lost" || name === "held") && samples) rows[name] = [value ? `${count(value)} (${number((100 * value) / samples, 2)} %)` : "0", ""];
    else if (typeof value === "number") rows[name] = [Number.isInteger(value) ? count(value) : number(value), ""];
    else if (typeof value === "string") rows[name] = [value, ""];
  }
  if (!Object.keys(rows).length) rows.link = ["no samples", ""];
  const host = byId("health");
  if (Object.keys(rows).join() !== [...cells.keys()].join()) {
    cells.clear();
    fill(host, ...Object.keys(rows).flatMap((name) => {
      const cell = make("dd", {});
      cells.set(name, cell);
      return [make("dt", {}, NAMES[name] ?? name.replaceAll("_", " ")), cell];
    }));
  }
  for (const [name, [text, tone]] of Object.entries(rows)) {
    const cell = /** @type {HTMLElement} */ (cells.get(name));
    say(cell, text);
    cell.className = tone;
  }
}

/** @param {Record<string, any>} from @param {string[]} names */
const pick = (from, names) => Object.fromEntries(names.filter((name) => from[name] !== undefined).map((name) => [name, from[name]]));
