// The vibration pattern in the plane: the last few periods as sensed, the older the paler, and the axis they lie along.

import { cleared } from "./canvas.js";
import { byId, colour, fill, make, say } from "./dom.js";
import { ellipseOf } from "./ellipse.js";
import { number, quantity } from "./numbers.js";

/** @typedef {import("./live.js").Live} Live */
/** @typedef {import("./frame.js").Frame} Frame */

const PERIODS = 3;
const FADES = 5;
const ROOM = 1.16;

export class Pattern {
  /** @param {Live} live */
  constructor(live) {
    this.live = live;
    this.canvas = byId("pattern", HTMLCanvasElement);
    this.facts = ["long axis", "short axis", "orientation"].map((name) => ({ name, value: make("dd", {}, "–") }));
    fill(byId("pattern-facts"), ...this.facts.flatMap(({ name, value }) => [make("dt", {}, name), value]));
    this.radius = 0;
    /** unit of the samples */
    this.unit = "V";
    /** @type {import("./live.js").Subscription | null} */
    this.subscription = null;
    /** @type {Frame | null} */
    this.frame = null;
    this.waiting = false;
    this.described = 0;
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  show() {
    this.subscription ??= this.live.subscribe({ op: "pattern", periods: PERIODS }, (frame) => this.take(frame));
    this.draw();
  }

  /** @param {Frame} frame single samples of both axes */
  take(frame) {
    this.frame = frame;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.draw());
  }

  hide() {
    this.subscription?.close();
    this.subscription = null;
  }

  draw() {
    this.waiting = false;
    const sheet = cleared(this.canvas);
    if (!sheet) return;
    const { ink, width } = sheet;
    const middle = width / 2;
    const rule = colour("--rule");
    const muted = colour("--muted");
    ink.lineWidth = 1;
    ink.strokeStyle = rule;
    ink.beginPath();
    ink.arc(middle, middle, middle / ROOM, 0, 2 * Math.PI);
    ink.moveTo(middle, 4);
    ink.lineTo(middle, width - 4);
    ink.moveTo(4, middle);
    ink.lineTo(width - 4, middle);
    for (let tick = 0; tick < 24; tick += 1) {
      const [c, s] = [Math.cos((tick * Math.PI) / 12), Math.sin((tick * Math.PI) / 12)];
      const inner = middle / ROOM - (tick % 6 === 0 ? 8 : 4);
      ink.moveTo(middle + c * inner, middle - s * inner);
      ink.lineTo(middle + (c * middle) / ROOM, middle - (s * middle) / ROOM);
    }
    ink.stroke();
    ink.fillStyle = muted;
    ink.font = "11px Inter, 'Segoe UI', Roboto, sans-serif";
    ink.fillText("x", width - 10, middle - 5);
    ink.fillText("y", middle + 5, 12);
    const [x, y] = this.frame?.channels.map((channel) => channel.max) ?? [];
    const ellipse = x && y ? ellipseOf(x, y) : null;
    if (!x || !y || !ellipse || !this.frame) {
      ink.textAlign = "center";
      ink.fillText("no samples", middle, middle - 8);
      ink.textAlign = "start";
      return;
    }
    // the scale follows a growing pattern at once and a shrinking one slowly, in steps, so that it can be read
    const size = steps(ellipse.long * 1.02);
    if (size > this.radius || size < this.radius * 0.45) this.radius = size;
    const scale = middle / ROOM / this.radius;
    const place = (/** @type {number} */ i) => /** @type {const} */ ([middle + (x[i] - ellipse.x) * scale, middle - (y[i] - ellipse.y) * scale]);
    const first = colour("--first");
    ink.strokeStyle = colour("--second");
    ink.setLineDash([4, 4]);
    ink.beginPath();
    const [c, s] = [Math.cos(ellipse.angle) * (middle / ROOM), Math.sin(ellipse.angle) * (middle / ROOM)];
    ink.moveTo(middle - c, middle + s);
    ink.lineTo(middle + c, middle - s);
    ink.stroke();
    ink.setLineDash([]);
    ink.strokeStyle = first;
    ink.lineWidth = 1.4;
    ink.lineJoin = "round";
    const part = Math.ceil(x.length / FADES);
    for (let fade = 0; fade < FADES; fade += 1) {
      ink.globalAlpha = 0.15 + (0.85 * (fade + 1)) / FADES;
      ink.beginPath();
      for (let i = fade * part; i <= Math.min((fade + 1) * part, x.length - 1); i += 1) ink.lineTo(...place(i));
      ink.stroke();
    }
    ink.globalAlpha = 1;
    ink.fillStyle = first;
    ink.beginPath();
    ink.arc(...place(x.length - 1), 3.2, 0, 2 * Math.PI);
    ink.fill();
    ink.fillStyle = muted;
    const { unit } = this;
    ink.fillText(`radius ${quantity(this.radius, unit, 2)}`, 4, width - 4);
    const degrees = (ellipse.angle * 180) / Math.PI;
    say(this.facts[0].value, quantity(ellipse.long, unit, 4));
    say(this.facts[1].value, quantity(ellipse.short, unit, 3));
    say(this.facts[2].value, `${number(degrees, Math.abs(degrees) < 10 ? 2 : 3)}°`);
    if (performance.now() - this.described > 2000) {
      this.described = performance.now();
      this.canvas.setAttribute("aria-label", `Vibration pattern in the plane: half axes ${quantity(ellipse.long, unit)} and ${quantity(ellipse.short, unit)}, orientation ${number(degrees, 3)} degrees`);
    }
  }
}

/** @param {number} size @returns {number} the next of 1, 1.25, 1.6, 2, 2.5, 3.2, 4, 5, 6.3, 8, 10 above it */
function steps(size) {
  if (!(size > 0)) return 1;
  return 10 ** (Math.ceil(10 * Math.log10(size) - 1e-9) / 10);
}
