// Samples of a few quantities over the last while, oldest first, for curves of what is told several times a second.

export class History {
  /** @param {number} spanS how far back */
  constructor(spanS) {
    this.spanS = spanS;
    /** @type {number[]} */
    this.t = [];
    /** @type {Record<string, (number | null)[]>} */
    this.values = {};
  }

  /**
   * @param {number} t a time before the last one, as of a new run, begins anew
   * @param {Record<string, number | null | undefined>} values
   */
  add(t, values) {
    const last = this.t[this.t.length - 1];
    if (last !== undefined && t === last) return;
    if (last !== undefined && t < last) this.clear();
    for (const name of Object.keys(values)) this.values[name] ??= Array(this.t.length).fill(null);
    this.t.push(t);
    for (const [name, series] of Object.entries(this.values)) series.push(finite(values[name]));
    let old = 0;
    while (this.t[old] < t - this.spanS) old += 1;
    if (old < 64) return; // cut off rarely: it copies
    this.t.splice(0, old);
    for (const series of Object.values(this.values)) series.splice(0, old);
  }

  /**
   * What was recorded before the first that was told.
   *
   * @param {number[]} t
   * @param {Record<string, (number | null)[]>} values
   */
  recall(t, values) {
    const { t: told, values: own } = this;
    const before = told.length ? t.filter((at) => at < told[0]).length : t.length;
    for (const name of Object.keys(own)) this.values[name] = [...(values[name]?.slice(0, before) ?? Array(before).fill(null)), ...own[name]];
    if (!told.length) this.values = Object.fromEntries(Object.entries(values).map(([name, series]) => [name, [...series]]));
    this.t = [...t.slice(0, before), ...told];
  }

  clear() {
    this.t = [];
    this.values = {};
  }
}

/** @param {number | null | undefined} value */
const finite = (value) => (value !== null && value !== undefined && Number.isFinite(value) ? value : null);
