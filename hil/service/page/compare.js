// Two runs side by side: their figures with what lies between them, and their curves over one another.

import { get, getBytes, query } from "./api.js";
import { Chart, gapped } from "./chart.js";
import { byId, fill, make } from "./dom.js";
import { figure, nameOf } from "./figures.js";
import { decode, times } from "./frame.js";
import { complain } from "./notices.js";
import { scaled, uncertain } from "./numbers.js";

const FIRST = ["estimates.angle_rad", "estimates.angle_u_rad", "estimates.rate_rad_s", "innovation.nu_x_V", "innovation.nu_y_V", "innovation.x_V"];
const POINTS = 600;
const AT_MOST = 4;

export class Compare {
  title = "Compare";

  constructor() {
    this.host = byId("view-compare");
    /** @type {Chart[]} */
    this.charts = [];
    /** @type {AbortController | null} of the pair that is shown: the answer for another comes too late */
    this.asked = null;
  }

  /** @param {string} [a] @param {string} [b] */
  async show(a = "", b = "") {
    this.hide();
    this.asked?.abort();
    this.asked = new AbortController();
    const { signal } = this.asked;
    if (!a || !b) {
      fill(this.host, make("h1", {}, "Compare"), make("p", { class: "note" }, "Choose two runs in the ", make("a", { href: "#/runs" }, "list of runs"), "."));
      return;
    }
    try {
      const answer = await get(`/api/compare${query({ a, b })}`, signal);
      await this.draw(a, b, answer);
    } catch (error) {
      if (signal.aborted) return;
      fill(this.host, make("h1", {}, "Compare"), make("p", { class: "note" }, "These two cannot be compared."));
      complain(error);
    }
  }

  hide() {
    for (const chart of this.charts) chart.close();
    this.charts = [];
  }

  /** @param {string} a @param {string} b @param {any} answer */
  async draw(a, b, answer) {
    const one = (/** @type {string} */ id, /** @type {string} */ ink) => make("span", {}, make("i", { class: `swatch ${ink}` }), make("a", { href: `#/runs/${encodeURIComponent(id)}` }, id));
    const rows = answer.figures.map((/** @type {any} */ row) => {
      const better = row.better === "a" ? "a" : row.better === "b" ? "b" : "";
      const cell = (/** @type {"a" | "b"} */ side) => make("td", { class: `n ${better === side ? "word good" : ""}` }, figure(row.name, row[side], row.unit), better === side && make("span", { class: "quiet" }, ", better"));
      return make("tr", {}, make("th", { scope: "row" }, nameOf(row.name)), cell("a"), cell("b"), make("td", { class: "n" }, difference(row)));
    });
    const keys = (answer.bench ?? []).map((/** @type {any} */ key) => make("tr", {}, make("th", { scope: "row" }, make("code", {}, key.key)), make("td", {}, plain(key.a)), make("td", {}, plain(key.b))));
    const overlays = make("div", { class: "overlays" });
    fill(
      this.host,
      make("h1", {}, "Two runs side by side"),
      make("div", { class: "legend" }, one(a, "ink-1"), one(b, "ink-2")),
      make("div", { class: "wide", tabIndex: 0, role: "region", "aria-label": "Figures of both" },
        make("table", {}, make("thead", {}, make("tr", {}, ...["figure", "first", "second", "difference"].map((title, i) => make("th", { scope: "col", class: i ? "n" : "" }, title)))), make("tbody", {}, ...rows))),
      overlays,
      keys.length > 0 && make("h2", {}, "Bench files apart"),
      keys.length > 0 && make("div", { class: "wide", tabIndex: 0, role: "region", "aria-label": "Keys of the bench files that differ" },
        make("table", {}, make("thead", {}, make("tr", {}, ...["key", "first", "second"].map((title) => make("th", { scope: "col" }, title)))), make("tbody", {}, ...keys))),
    );
    /** @type {string[]} */
    const names = answer.channels;
    /** @type {Record<string, string>} */
    const units = Object.fromEntries((await get(`/api/runs/${encodeURIComponent(a)}/channels`)).map((/** @type {any} */ channel) => [channel.name, channel.unit]));
    const best = FIRST.filter((name) => names.includes(name)).concat(names.filter((name) => !FIRST.includes(name)));
    for (const name of best.slice(0, AT_MOST)) this.overlay(overlays, a, b, name, units[name] ?? "");
    const others = best.slice(AT_MOST);
    if (!others.length) return;
    const select = make("select", { "aria-label": "Another curve" }, make("option", { value: "" }, "another curve …"), ...others.map((/** @type {string} */ name) => make("option", {}, name)));
    select.addEventListener("change", () => {
      if (select.value) this.overlay(overlays, a, b, select.value, units[select.value] ?? "");
      select.value = "";
    });
    this.host.append(make("p", { class: "note" }, select));
  }

  /** @param {HTMLElement} host @param {string} a @param {string} b @param {string} name @param {string} unit */
  async overlay(host, a, b, name, unit) {
    const place = make("div", { class: "chart overlay" });
    host.append(make("section", { "aria-label": name }, make("h2", {}, name), place));
    try {
      const frames = (await Promise.all([a, b].map((id) => getBytes(`/api/runs/${encodeURIComponent(id)}/series${query({ channels: name, points: POINTS })}`)))).map(decode);
      const size = Math.max(...frames.flatMap((frame) => [...frame.channels[0].max, ...frame.channels[0].min].map(Math.abs).filter(Number.isFinite)), 0);
      const best = scaled(size, unit);
      const chart = new Chart(place, {
        label: `${name} of both runs over time`,
        y: best.unit,
        x: "time / s",
        zoom: true,
        lines: [{ label: a, colour: "--first", kind: "envelope" }, { label: b, colour: "--second", kind: "envelope" }],
      });
      this.charts.push(chart);
      await chart.ready;
      const x = [...new Set(frames.flatMap((frame) => [...times(frame)]))].sort((left, right) => left - right);
      chart.set(x, frames.map((frame) => onto(x, frame, best.factor)));
    } catch (error) {
      fill(place, make("p", { class: "note" }, "Not recorded in both."));
      complain(error);
    }
  }
}

/** @param {any} row @returns {string} with its uncertainty where it has one */
function difference(row) {
  if (row.difference === null || row.difference === undefined) return "–";
  if (!row.uncertainty) return figure(row.name, row.difference, row.unit);
  const written = uncertain(row.difference, row.uncertainty, row.unit);
  return `${written.value} ± ${written.spread} ${written.unit}`;
}

/** @param {unknown} value @returns {string} */
const plain = (value) => (value === null || value === undefined ? "–" : typeof value === "string" ? value : JSON.stringify(value));

/** @param {number[]} x @param {import("./frame.js").Frame} frame @param {number} factor */
function onto(x, frame, factor) {
  const at = new Map([...times(frame)].map((time, i) => [time, i]));
  const pick = (/** @type {Float64Array} */ values) => {
    const own = gapped(values, factor);
    return x.map((time) => {
      const i = at.get(time);
      return i === undefined ? /** @type {any} */ (undefined) : own[i]; // undefined: the line goes on; null: a gap
    });
  };
  return { low: pick(frame.channels[0].min), high: pick(frame.channels[0].max) };
}
