// The scope: sensed voltages, drives, innovation, as they come or held by a trigger. Paused, it shows what was
// recorded: dragging zooms, down to single samples, and two cursors measure.

import { get, getBytes, query } from "./api.js";
import { Chart, gapped } from "./chart.js";
import { byId, fill, make, say } from "./dom.js";
import { decode, times } from "./frame.js";
import { complain } from "./notices.js";
import { number, quantity, scaled } from "./numbers.js";
import { endOf, Window } from "./window.js";

/** @typedef {import("./live.js").Live} Live */
/** @typedef {import("./frame.js").Frame} Frame */
/** @typedef {{ name: string, label: string, unit: string, colour: string, ink: string, on: boolean }} Channel */

const SPANS_S = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60];
const POINTS = 800;
const ZOOMED_POINTS = 2000;
const CURSORS = ["A", "B"];

/** What a channel is called here, how it is drawn, and whether it is at first. @type {[RegExp, string, number, boolean][]} */
const KINDS = [
  [/^capture\.vx_/, "sensed x", 1, true],
  [/^capture\.vy_/, "sensed y", 2, true],
  [/^innovation\.nu_x_/, "innovation x", 3, false],
  [/^innovation\.nu_y_/, "innovation y", 4, false],
  [/^capture\.ux_/, "drive x", 1, false],
  [/^capture\.uy_/, "drive y", 2, false],
];
const COLOURS = ["", "--first", "--second", "--third", "--fourth"];
const USUAL = [["capture.vx_V", "V"], ["capture.vy_V", "V"], ["innovation.nu_x_V", "V"], ["innovation.nu_y_V", "V"], ["capture.ux_mps2", "m/s²"], ["capture.uy_mps2", "m/s²"]].map(([name, unit]) => ({ name, unit }));

/** @param {{ name: string, unit: string }[]} recorded @param {Channel[]} [before] whose choice stands @returns {Channel[]} */
function channelsOf(recorded, before = []) {
  return KINDS.flatMap(([pattern, label, ink, first]) => {
    const found = recorded.find(({ name }) => pattern.test(name));
    const on = before.find((channel) => channel.label === label)?.on ?? first;
    return found ? [{ ...found, label, colour: COLOURS[ink], ink: `ink-${ink}`, on }] : [];
  });
}

export class Scope {
  /** @param {Live} live */
  constructor(live) {
    this.live = live;
    this.host = byId("scope-chart");
    this.channels = channelsOf(USUAL);
    this.span = byId("scope-span", HTMLSelectElement);
    this.mode = byId("scope-mode", HTMLSelectElement);
    this.source = byId("scope-source", HTMLSelectElement);
    this.level = byId("scope-level", HTMLInputElement);
    this.pauseButton = byId("scope-pause", HTMLButtonElement);
    this.single = byId("scope-single", HTMLButtonElement);
    this.save = byId("scope-save", HTMLButtonElement);
    this.window = new Window(0.02);
    this.shown = false;
    this.paused = false;
    this.once = false;
    this.waiting = false;
    /** @type {Frame | null} */
    this.frame = null;
    /** @type {[number, number] | null} what is shown of a paused scope; the frame as it was paused where null */
    this.zoom = null;
    /** @type {[number, number] | undefined} what was on the screen when it was paused */
    this.whole = undefined;
    this.flowing = "";
    /** @type {string | null} the run, once what it recorded can be asked for */
    this.run = null;
    /** @type {(number | null)[]} */
    this.cursors = [null, null];
    this.nextCursor = 0;
    /** @type {import("./live.js").Subscription | null} */
    this.subscription = null;
    /** @type {AbortController | null} */
    this.asked = null;
    this.chart = this.makeChart();
    this.layOut();
    this.listen();
  }

  makeChart() {
    return new Chart(this.host, {
      label: "Scope",
      x: "bench time / s",
      zoom: true,
      lines: [],
      onZoom: (from, to) => (Number.isNaN(from) ? this.look(null) : this.look([from, to])),
      onClick: (at) => this.place(at),
    });
  }

  layOut() {
    this.host.setAttribute("role", "group");
    this.host.tabIndex = 0;
    this.host.setAttribute("aria-describedby", "scope-help");
    fill(this.span, ...SPANS_S.map((span) => make("option", { value: String(span), selected: span === 0.02 }, quantity(span, "s", 1))));
    this.choices();
  }

  choices() {
    fill(byId("scope-channels"), ...this.channels.map((channel) => {
      const box = make("input", { type: "checkbox", checked: channel.on });
      box.addEventListener("change", () => {
        channel.on = box.checked;
        this.ask();
      });
      return make("label", {}, box, make("i", { class: `swatch ${channel.ink}` }), channel.label);
    }));
  }

  listen() {
    for (const control of [this.span, this.mode, this.source, this.level]) {
      control.addEventListener("change", () => {
        if (this.paused) this.pause(false);
        this.ask();
      });
    }
    this.pauseButton.addEventListener("click", () => this.pause(!this.paused));
    this.single.addEventListener("click", () => {
      this.pause(false);
      this.once = true;
      this.ask();
    });
    this.save.addEventListener("click", () => this.saveCsv());
    this.host.addEventListener("keydown", (event) => this.key(event));
  }

  /** @param {string} run whose samples flow */
  show(run) {
    this.shown = true;
    if (this.paused && run !== this.flowing) this.pause(false);
    this.flowing = run;
    this.ask();
  }

  /** From now on what is paused can be zoomed into, and the channels are those of the run. @param {string} run */
  async begin(run) {
    this.run = run;
    const recorded = await get(`/api/runs/${encodeURIComponent(run)}/channels`);
    const channels = channelsOf(recorded, this.channels);
    if (run !== this.run || !channels.length || channels.map(({ name }) => name).join() === this.channels.map(({ name }) => name).join()) return;
    this.channels = channels;
    this.choices();
    this.ask();
  }

  /** The end of a run that has ended. @param {string} run @param {number} end @param {() => boolean} wanted */
  async last(run, end, wanted) {
    await this.begin(run);
    if (!wanted()) return;
    this.hide();
    if (this.channels.length) await this.look([Math.max(0, end - Number(this.span.value)), end]);
  }

  hide() {
    this.shown = false;
    this.subscription?.close();
    this.subscription = null;
  }

  /** The channels that are drawn, in units that share an axis: those of the first that is on. */
  get on() {
    const on = this.channels.filter((channel) => channel.on);
    return on.filter((channel) => channel.unit === on[0].unit);
  }

  ask() {
    const on = this.on;
    const triggered = this.mode.value !== "roll";
    byId("scope-trigger").hidden = !triggered;
    this.single.hidden = !triggered;
    const chosen = this.source.value;
    fill(this.source, ...on.map((channel) => make("option", { value: channel.name, selected: channel.name === chosen }, channel.label)));
    say(byId("scope-level-unit"), on[0]?.unit ?? "");
    const span = Number(this.span.value);
    this.window = new Window(span);
    this.chart.setLines(on.map((channel) => ({ label: channel.label, colour: channel.colour, kind: "envelope" })));
    if (!this.shown) return;
    if (!on.length) return this.hide();
    const request = {
      op: "subscribe",
      channels: on.map((channel) => channel.name),
      window_s: span,
      points: POINTS,
      mode: triggered ? "trigger" : "roll",
      ...(triggered ? { trigger: { channel: this.source.value, level: Number(this.level.value) || 0, edge: this.mode.value } } : {}),
    };
    // a new subscription: a frame on its way must not be taken for one of the new channels
    this.subscription?.close();
    this.subscription = this.live.subscribe(request, (frame) => this.take(frame));
    this.help();
  }

  /** @param {Frame} frame */
  take(frame) {
    if (this.paused) return;
    this.frame = this.mode.value === "roll" ? this.window.add(frame) : frame;
    if (this.once) {
      this.once = false;
      this.pause(true);
    }
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  draw() {
    const { frame } = this;
    if (!frame || frame.channels.length !== this.on.length) return;
    const x = times(frame);
    let size = 0;
    for (const { min, max } of frame.channels) for (let i = 0; i < frame.buckets; i += 1) size = Math.max(size, -min[i] || 0, max[i] || 0);
    const best = scaled(size, this.on[0].unit);
    if (this.chart.options.y !== best.unit) {
      this.chart.options.y = best.unit;
      this.chart.build();
    }
    const span = this.zoom ?? (this.mode.value === "roll" && !this.paused ? /** @type {[number, number]} */ ([endOf(frame) - Number(this.span.value), endOf(frame)]) : null);
    this.chart.set(x, frame.channels.map(({ min, max }) => ({ low: gapped(min, best.factor), high: gapped(max, best.factor) })), span);
  }

  /** @param {boolean} paused */
  pause(paused) {
    this.paused = paused;
    this.zoom = null;
    this.whole = paused && this.frame ? [this.frame.t0, endOf(this.frame)] : undefined;
    this.pauseButton.setAttribute("aria-pressed", String(paused));
    say(this.pauseButton, paused ? "Go on" : "Pause");
    this.save.hidden = !paused;
    if (!paused) {
      this.cursors = [null, null];
      this.mark();
    }
    this.help();
  }

  help() {
    say(
      byId("scope-help"),
      this.paused
        ? "Drag, or + and −, to zoom into what was recorded; 0 shows all. Click, or A and B with ← and →, to place the cursors."
        : "Pause (space) to zoom into single samples and to measure.",
    );
  }

  /** Show a stretch of what was recorded; all that was on the screen where null. @param {[number, number] | null} range */
  async look(range) {
    if (!this.paused) this.pause(true);
    this.zoom = range;
    const [from, to] = range ?? this.whole ?? [];
    const { run } = this;
    if (!run || from === undefined || to === undefined) return this.draw();
    this.asked?.abort();
    this.asked = new AbortController();
    try {
      const bytes = await getBytes(`/api/runs/${encodeURIComponent(run)}/series${query({ channels: this.on.map((channel) => channel.name).join(), from, to, points: ZOOMED_POINTS })}`, this.asked.signal);
      const frame = decode(bytes);
      if (!this.paused || frame.buckets === 0) return this.draw();
      this.frame = frame;
      this.draw();
      say(byId("scope-readout"), this.raw ? `single samples, ${quantity(1 / frame.dt, "Hz", 3)}` : "");
      this.mark();
    } catch (error) {
      complain(error);
    }
    return undefined;
  }

  get raw() {
    return this.frame?.channels.every(({ min, max }) => min.every((value, i) => Number.isNaN(value) || value === max[i])) ?? false;
  }

  /** @param {number} at */
  place(at) {
    if (!this.paused) this.pause(true);
    this.cursors[this.nextCursor] = at;
    this.nextCursor = 1 - this.nextCursor;
    this.mark();
  }

  mark() {
    this.chart.setMarks(this.cursors.flatMap((at, i) => (at === null ? [] : [{ at, name: CURSORS[i] }])));
    const [a, b] = this.cursors;
    const written = (/** @type {number[]} */ values, /** @type {number} */ digits) => values.map((value, i) => `${this.on[i].label} ${quantity(value, this.on[i].unit, digits)}`).join(", ");
    const parts = [];
    for (const [i, at] of this.cursors.entries()) if (at !== null) parts.push(`${CURSORS[i]}  ${number(at, 7)} s, ${written(this.values(at), 4)}`);
    if (a !== null && b !== null) {
      const [left, right] = [this.values(a), this.values(b)];
      parts.push(`B − A  ${quantity(b - a, "s", 4)}, ${quantity(1 / Math.abs(b - a), "Hz", 4)}, ${written(left.map((value, i) => right[i] - value), 3)}`);
    }
    if (parts.length || !this.paused) fill(byId("scope-readout"), ...parts.map((part) => make("span", {}, part)));
  }

  /** @param {number} at @returns {number[]} of each channel, the middle of the bucket */
  values(at) {
    const { frame } = this;
    if (!frame) return [];
    const i = Math.max(0, Math.min(frame.buckets - 1, Math.round((at - frame.t0) / frame.dt)));
    return frame.channels.map(({ min, max }) => (min[i] + max[i]) / 2);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const { frame } = this;
    const range = this.zoom ?? (frame ? /** @type {[number, number]} */ ([frame.t0, endOf(frame)]) : null);
    const key = event.key.toLowerCase();
    if (key === " ") this.pause(!this.paused);
    else if (range && (key === "+" || key === "=")) this.look(this.around(range, 0.5));
    else if (range && (key === "-" || key === "−")) this.look(this.around(range, 2));
    else if (key === "0") this.look(null);
    else if (range && (key === "a" || key === "b")) {
      this.nextCursor = key === "a" ? 0 : 1;
      this.place(this.cursors[this.nextCursor] ?? (range[0] + range[1]) / 2);
      this.nextCursor = key === "a" ? 0 : 1;
    } else if (range && (key === "arrowleft" || key === "arrowright") && this.cursors[this.nextCursor] !== null) {
      const step = (range[1] - range[0]) / (event.shiftKey ? 20 : 200);
      const cursor = this.nextCursor;
      this.place(/** @type {number} */ (this.cursors[cursor]) + (key === "arrowleft" ? -step : step));
      this.nextCursor = cursor;
    } else return;
    event.preventDefault();
  }

  /** @param {[number, number]} range @param {number} factor @returns {[number, number]} about the cursor that was placed last */
  around([from, to], factor) {
    const cursor = this.cursors[this.nextCursor] ?? this.cursors[1 - this.nextCursor];
    const middle = cursor ?? (from + to) / 2;
    const half = ((to - from) * factor) / 2;
    return [middle - half, middle + half];
  }

  saveCsv() {
    const { frame } = this;
    if (!frame) return;
    const names = this.on.map((channel) => channel.name.replace(/^\w+\./, ""));
    const raw = this.raw;
    const head = raw ? ["t_s", ...names] : ["t_s", ...names.flatMap((name) => [`min_${name}`, `max_${name}`])];
    const lines = Array.from({ length: frame.buckets }, (_, i) =>
      [(frame.t0 + i * frame.dt).toPrecision(12), ...frame.channels.flatMap(({ min, max }) => (raw ? [max[i]] : [min[i], max[i]]))].join());
    const address = URL.createObjectURL(new Blob([`${[head.join(), ...lines].join("\n")}\n`], { type: "text/csv" }));
    make("a", { href: address, download: "scope.csv" }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }
}
