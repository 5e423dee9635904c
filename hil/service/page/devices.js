// Devices by serial number, and how a figure went over the runs of one of them.

import { get, query } from "./api.js";
import { Chart } from "./chart.js";
import { byId, fill, make } from "./dom.js";
import { nameOf, unitOf } from "./figures.js";
import { complain } from "./notices.js";
import { count, moment, number, scaled } from "./numbers.js";
import { drawHead, drawRow } from "./table.js";
import { verdictOf } from "./verdict.js";

const FIGURES = ["angle_expanded_rad", "angle_error_rms_rad", "rate_error_rms_rad_s", "innovation_rms", "noise_floor", "late", "lost"];

export class Devices {
  title = "Devices";

  constructor() {
    this.table = byId("devices-table", HTMLTableElement);
    this.detail = byId("device");
    /** @type {Chart | null} */
    this.chart = null;
    this.figure = FIGURES[0];
    /** @type {AbortController | null} what is being asked for the view: an answer to what was asked before comes too late */
    this.asked = null;
    /** @type {import("./table.js").Column<any>[]} */
    this.columns = [
      { title: "serial number", heads: true, cell: (row) => make("a", { href: `#/devices/${encodeURIComponent(row.serial)}` }, row.serial || "none") },
      { title: "device", cell: (row) => row.device ?? "–" },
      { title: "runs", figure: true, cell: (row) => count(row.runs) },
      { title: "last", optional: true, cell: (row) => moment(row.last) },
      { title: "verdict then", cell: (row) => verdictOf(row) },
    ];
  }

  /** @param {string} [serial] */
  async show(serial = "") {
    const { signal } = this.ask();
    try {
      const devices = await get("/api/devices", signal);
      drawHead(this.table, this.columns);
      fill(this.table.tBodies[0], ...devices.map((/** @type {any} */ row) => drawRow(this.columns, row, { "aria-selected": row.serial === serial ? "true" : undefined })));
      byId("devices-none").hidden = devices.length > 0;
      byId("devices-none").textContent = "No device yet: a run with a serial number makes one.";
      this.hide();
      this.detail.hidden = !serial;
      if (serial) await this.trend(serial, signal);
    } catch (error) {
      complain(error);
    }
  }

  hide() {
    this.chart?.close();
    this.chart = null;
  }

  /** @returns {AbortController} of what is asked from now on */
  ask() {
    this.asked?.abort();
    this.asked = new AbortController();
    return this.asked;
  }

  /** @param {string} serial @param {AbortSignal} signal */
  async trend(serial, signal) {
    const path = `/api/devices/${encodeURIComponent(serial)}`;
    const device = await get(path, signal);
    const names = device.figures?.length ? device.figures.map((/** @type {any} */ one) => one.name) : FIGURES;
    if (!names.includes(this.figure)) this.figure = names[0];
    const select = make("select", { id: "trend-figure" }, ...names.map((/** @type {string} */ name) => make("option", { value: name, selected: name === this.figure }, nameOf(name))));
    const place = make("div", { class: "chart tall" });
    const points = make("tbody", {});
    select.addEventListener("change", () => {
      this.figure = select.value;
      this.draw(path, place, points, this.ask().signal).catch(complain);
    });
    fill(
      this.detail,
      make("div", { class: "head" }, make("h2", {}, device.device ? `${device.device} ${serial}` : serial), make("a", { href: "#/devices" }, "Close")),
      make("p", {}, make("label", { class: "inline" }, "Trend of ", select)),
      place,
      make("table", {}, make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "run"), make("th", { scope: "col", class: "n" }, "value"))), points),
    );
    await this.draw(path, place, points, signal);
  }

  /** @param {string} path @param {HTMLElement} place @param {HTMLElement} list @param {AbortSignal} signal */
  async draw(path, place, list, signal) {
    const answer = await get(`${path}/trend${query({ figure: this.figure })}`, signal);
    const points = (answer.points ?? []).filter((/** @type {any} */ point) => point.value !== null);
    const best = scaled(Math.max(...points.map((/** @type {any} */ point) => Math.abs(point.value)), 0), unitOf(this.figure, answer.unit));
    this.chart?.close();
    this.chart = new Chart(place, {
      label: `${nameOf(this.figure)} over ${points.length} runs`,
      y: best.unit,
      x: "run, the oldest first",
      lines: [{ label: this.figure, colour: "--first", kind: "plain", dots: true }],
    });
    await this.chart.ready;
    if (signal.aborted) return;
    this.chart.set(points.map((/** @type {any} */ _, /** @type {number} */ i) => i + 1), [{ mid: points.map((/** @type {any} */ point) => point.value * best.factor) }], [0.5, points.length + 0.5]);
    fill(list, ...points.toReversed().map((/** @type {any} */ point) =>
      make("tr", {}, make("th", { scope: "row" }, make("a", { href: `#/runs/${encodeURIComponent(point.run)}` }, moment(point.time))), make("td", { class: "n" }, `${number(point.value * best.factor)} ${best.unit}`))));
  }
}
