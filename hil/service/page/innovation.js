// The innovation, measured minus predicted: in time, and its spectrum, in which what the model lacks stands out as lines.

import { Chart, gapped } from "./chart.js";
import { byId, say } from "./dom.js";
import { times } from "./frame.js";
import { quantity } from "./numbers.js";
import { endOf, Window } from "./window.js";

/** @typedef {import("./live.js").Live} Live */

const SPAN_S = 10;
const CHANNELS = ["innovation.nu_x_V", "innovation.nu_y_V"];

export class Innovation {
  /** @param {Live} live */
  constructor(live) {
    this.live = live;
    this.window = new Window(SPAN_S);
    const lines = /** @type {import("./chart.js").Line[]} */ ([
      { label: "x", colour: "--first", kind: "envelope" },
      { label: "y", colour: "--second", kind: "envelope" },
    ]);
    this.time = new Chart(byId("innovation-chart"), { label: "Innovation of both axes over the last ten seconds", y: "µV", x: "time / s", settles: true, lines });
    this.spectrum = new Chart(byId("spectrum-chart"), { label: "Spectrum of the innovation", y: "µV/√Hz", x: "frequency / Hz", log: true, lines: lines.map((line) => ({ ...line, kind: "plain" })) });
    /** @type {import("./live.js").Subscription[]} */
    this.subscriptions = [];
    /** @type {(import("./frame.js").Frame | null)[]} */
    this.spectra = [null, null];
    this.waiting = false;
  }

  show() {
    if (this.subscriptions.length) return;
    this.subscriptions = [
      this.live.subscribe({ op: "subscribe", channels: CHANNELS, window_s: SPAN_S, points: 400, mode: "roll" }, (frame) => this.take(frame)),
      ...CHANNELS.map((channel, axis) =>
        this.live.subscribe({ op: "spectrum", channel }, (frame) => {
          this.spectra[axis] = frame;
          this.later();
        })),
    ];
  }

  /** @param {import("./frame.js").Frame} frame */
  take(frame) {
    this.window.add(frame);
    this.later();
  }

  hide() {
    for (const subscription of this.subscriptions) subscription.close();
    this.subscriptions = [];
  }

  later() {
    if (this.waiting) return;
    this.waiting = true;
    setTimeout(() => {
      this.waiting = false;
      this.draw();
    }, 90);
  }

  draw() {
    const { frame } = this.window;
    if (frame?.buckets) this.time.set(times(frame), frame.channels.map(({ min, max }) => ({ low: gapped(min, 1e6), high: gapped(max, 1e6) })), [Math.max(0, endOf(frame) - SPAN_S), endOf(frame)]);
    const [x, y] = this.spectra;
    if (!x?.buckets) return;
    const above = (/** @type {import("./frame.js").Frame | null} */ one) => (one && one.buckets === x.buckets ? Array.from(one.channels[0].max, (value) => (value > 0 ? value * 1e6 : null)) : []);
    this.spectrum.set(times(x), [{ mid: above(x) }, { mid: above(y) }]);
  }

  /** @param {any} run what the loop says of it */
  set(run) {
    const told = run?.innovation;
    if (!told) return;
    const { rms_V: rms, ratio } = told;
    say(byId("innovation-value"), rms ? `${quantity(rms, "V", 3)} rms${ratio ? `, ${ratio.toFixed(2)} × predicted` : ""}` : "");
  }
}
