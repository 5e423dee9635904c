// Curves over one axis, drawn by uPlot. Where uPlot was not fetched, a chart says so and everything else goes on.

import { sizeOf } from "./canvas.js";
import { colour, fill, make } from "./dom.js";
import { number } from "./numbers.js";

/** @typedef {import("./vendor/uPlot.esm.js")} UPlot */

/**
 * One quantity of a chart: a line with an optional band, or the least and greatest of each pixel.
 *
 * @typedef {object} Line
 * @property {string} label
 * @property {string} colour a custom property of the page, e.g. --first
 * @property {"envelope" | "band" | "plain"} [kind] plain unless said otherwise
 * @property {boolean} [dashed]
 * @property {boolean} [dots] where points are few they are marked
 */

/**
 * @typedef {object} Curve values of one line: `mid` of a plain one, `low` and `high` of an envelope, all three of a band
 * @property {ArrayLike<number | null>} [mid]
 * @property {ArrayLike<number | null>} [low]
 * @property {ArrayLike<number | null>} [high]
 */

/** @type {Promise<typeof import("./vendor/uPlot.esm.js") | null>} */
const library = import("./vendor/uPlot.esm.js").then((module) => module.default, () => null);

const FONT = "11px Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, 'Liberation Sans', sans-serif";

export class Chart {
  /**
   * @param {HTMLElement} host
   * @param {object} options
   * @param {string} options.label what the chart shows, for those who do not see it
   * @param {Line[]} options.lines
   * @param {string} [options.y] label of the value axis
   * @param {string} [options.x] label of the other
   * @param {boolean} [options.zoom] by dragging; a double click shows all again
   * @param {boolean} [options.log] logarithmic values
   * @param {boolean} [options.settles] what is drawn begins far away: the axis of values fits the later half
   * @param {string} [options.sync] charts of the same name share the cursor
   * @param {(from: number, to: number) => void} [options.onZoom]
   * @param {(at: number | null) => void} [options.onCursor]
   * @param {(at: number) => void} [options.onClick]
   * @param {number[]} [options.minSpan] of the values: the axis is no narrower than this many times the middle…
   */
  constructor(host, options) {
    this.host = host;
    this.options = options;
    /** @type {UPlot | null} */
    this.plot = null;
    /** @type {[ArrayLike<number>, Curve[]] | null} */
    this.data = null;
    /** @type {[number, number] | null} */
    this.range = null;
    /** @type {{ at: number, name: string }[]} */
    this.marks = [];
    host.setAttribute("role", "img");
    host.setAttribute("aria-label", options.label);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.scheme.onchange = () => this.build();
    this.ready = library.then((uPlot) => {
      this.uPlot = uPlot;
      if (!uPlot) fill(host, make("p", { class: "note" }, "Curves need uPlot, which was not fetched: ", make("code", {}, "make install")));
      this.build();
    });
  }

  /** @param {Line[]} lines */
  setLines(lines) {
    this.options.lines = lines;
    this.data = null;
    this.build();
  }

  /**
   * @param {ArrayLike<number>} x
   * @param {Curve[]} curves one per line
   * @param {[number, number] | null} [range] of the axis; all of x where none is given
   */
  set(x, curves, range = null) {
    this.data = [x, curves];
    this.range = range;
    if (sizeOf(this.host).width === 0) return;
    if (!this.plot) return this.build();
    this.plot.setData(this.aligned(), false);
    this.fit();
    return undefined;
  }

  fit() {
    if (!this.plot || !this.data) return;
    const [x] = this.data;
    const [min, max] = this.range ?? [x[0] ?? 0, x[x.length - 1] ?? 1];
    this.plot.setScale("x", { min, max: max > min ? max : min + 1e-9 });
  }

  /** @param {{ at: number, name: string }[]} marks vertical cursors */
  setMarks(marks) {
    this.marks = marks;
    this.plot?.redraw(false);
  }

  close() {
    this.observer.disconnect();
    this.scheme.onchange = null;
    this.plot?.destroy();
    this.plot = null;
  }

  aligned() {
    const [x, curves] = this.data ?? [[], []];
    const rows = [x];
    this.options.lines.forEach((line, i) => {
      const curve = curves[i] ?? {};
      if (line.kind === "envelope" || line.kind === "band") rows.push(/** @type {any} */ (curve.high ?? []), /** @type {any} */ (curve.low ?? []));
      if (line.kind !== "envelope") rows.push(/** @type {any} */ (curve.mid ?? []));
    });
    return /** @type {any} */ (rows);
  }

  size() {
    return { width: Math.max(this.host.clientWidth, 60), height: Math.max(this.host.clientHeight, 60) };
  }

  resize() {
    if (!this.uPlot || this.host.clientWidth === 0) return;
    if (!this.plot) this.build();
    else this.plot.setSize(this.size());
  }

  build() {
    this.plot?.destroy();
    this.plot = null;
    this.host.classList.toggle("empty", !this.data);
    if (!this.uPlot || !this.data || this.host.clientWidth === 0) return;
    const { lines, y, x, zoom, log, settles, sync } = this.options;
    /** @type {any[]} */
    const series = [{}];
    /** @type {any[]} */
    const bands = [];
    for (const line of lines) {
      const ink = colour(line.colour);
      const points = { show: false };
      if (line.kind === "envelope" || line.kind === "band") {
        const edge = line.kind === "envelope" ? ink : "transparent";
        bands.push({ series: [series.length, series.length + 1], fill: ink + (line.kind === "envelope" ? "59" : "38") });
        series.push({ label: line.label, stroke: edge, width: 1, points: line.dots ? { show: true, size: 4 } : points }, { stroke: edge, width: 1, points });
      }
      if (line.kind !== "envelope") series.push({ label: line.label, stroke: ink, width: 1.4, dash: line.dashed ? [5, 4] : undefined, points });
    }
    const axis = (/** @type {string | undefined} */ label, /** @type {object} */ more) => ({
      label,
      labelSize: label ? 15 : 0,
      labelGap: 0,
      labelFont: FONT,
      font: FONT,
      stroke: colour("--muted"),
      grid: { stroke: colour("--rule"), width: 0.5 },
      ticks: { stroke: colour("--rule"), width: 0.5, size: 3 },
      gap: 3,
      ...more,
    });
    const width = (/** @type {any} */ plot, /** @type {string[] | null} */ values) =>
      Math.max(30, ...(values ?? []).map((value) => plot.ctx.measureText(value).width / devicePixelRatio + 9));
    this.plot = new this.uPlot(
      {
        ...this.size(),
        series,
        bands,
        legend: { show: false },
        padding: [6, 18, 0, 0],
        focus: { alpha: 1 },
        cursor: {
          show: Boolean(zoom || this.options.onCursor || sync),
          drag: { x: Boolean(zoom), y: false, setScale: !this.options.onZoom },
          points: { show: false },
          sync: sync ? { key: sync } : undefined,
          y: false,
          bind: this.options.onZoom ? /** @type {any} */ ({ dblclick: () => () => this.options.onZoom?.(NaN, NaN) }) : undefined,
        },
        scales: { x: { time: false, auto: false }, y: { distr: log ? 3 : 1, range: log ? undefined : settles ? settled : padded } },
        axes: [
          axis(x, { size: 18, values: (/** @type {any} */ _, /** @type {number[]} */ at) => ticks(at) }),
          axis(y, { size: width, space: 24, values: (/** @type {any} */ _, /** @type {(number | null)[]} */ at) => (log ? decades(at) : ticks(at)) }),
        ],
        hooks: {
          setSelect: [(/** @type {any} */ plot) => this.selected(plot)],
          setCursor: [(/** @type {any} */ plot) => this.options.onCursor?.(plot.cursor.idx === null || plot.cursor.idx === undefined ? null : plot.posToVal(plot.cursor.left, "x"))],
          draw: [(/** @type {any} */ plot) => this.drawMarks(plot)],
          ready: [(/** @type {any} */ plot) => this.listen(plot)],
        },
      },
      this.aligned(),
      this.host,
    );
    this.fit();
  }

  /** @param {any} plot */
  selected(plot) {
    const { left, width } = plot.select;
    if (width < 3 || !this.options.onZoom) return;
    const [from, to] = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.options.onZoom(from, to);
  }

  /** @param {any} plot */
  listen(plot) {
    if (!this.options.onClick) return;
    let down = 0;
    plot.over.addEventListener("mousedown", (/** @type {MouseEvent} */ event) => (down = event.clientX));
    plot.over.addEventListener("click", (/** @type {MouseEvent} */ event) => {
      if (Math.abs(event.clientX - down) < 3) this.options.onClick?.(plot.posToVal(event.offsetX, "x"));
    });
  }

  /** @param {any} plot */
  drawMarks(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.font = `${11 * devicePixelRatio}px ${FONT.slice(5)}`;
    for (const { at, name } of this.marks) {
      const left = plot.valToPos(at, "x", true);
      if (left < bbox.left || left > bbox.left + bbox.width) continue;
      ctx.strokeStyle = ctx.fillStyle = colour("--ink");
      ctx.lineWidth = devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(left, bbox.top);
      ctx.lineTo(left, bbox.top + bbox.height);
      ctx.stroke();
      ctx.fillText(name, left + 4 * devicePixelRatio, bbox.top + 11 * devicePixelRatio);
    }
    ctx.restore();
  }
}

/** @param {any} _ @param {number | null} low @param {number | null} high @returns {[number, number]} with a little room */
function padded(_, low, high) {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const room = 0.08 * (high - low) || 0.05 * Math.abs(high) || 1;
  return [low - room, high + room];
}

/** @param {{ data: ArrayLike<ArrayLike<number | null | undefined>> }} plot @returns {[number, number]} what the later half needs */
function settled({ data }) {
  let [low, high] = [Infinity, -Infinity];
  for (const values of Array.from(data).slice(1)) {
    for (let i = values.length >> 1; i < values.length; i += 1) {
      const value = values[i];
      if (value === null || value === undefined) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  return padded(null, low, high);
}

/** @param {(number | null)[]} at @returns {string[]} with as many decimals as tell the ticks apart */
function ticks(at) {
  const there = /** @type {number[]} */ (at.filter((value) => value !== null));
  const step = there.length > 1 ? Math.abs(there[1] - there[0]) : 1;
  const size = Math.max(...there.map(Math.abs), 0);
  const plain = size < 1e6 && step >= 1e-4;
  let decimals = 0;
  while (decimals < 6 && Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6 * step * 10 ** decimals) decimals += 1;
  return at.map((value) => (value === null ? "" : plain ? value.toFixed(decimals).replace("-", "−") : number(value, 3)));
}

/** @param {(number | null)[]} at @returns {string[]} powers of ten alone, as there is no room for more */
function decades(at) {
  return at.map((value) => (value !== null && Math.abs(Math.log10(value) % 1) < 1e-9 ? String(Number(value.toPrecision(1))) : ""));
}

/**
 * Values with NaN as gaps.
 *
 * @param {ArrayLike<number>} values
 * @param {number} [factor]
 * @returns {(number | null)[]}
 */
export function gapped(values, factor = 1) {
  return Array.from(values, (value) => (Number.isNaN(value) ? null : value * factor));
}
