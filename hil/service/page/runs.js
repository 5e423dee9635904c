// The catalogue: runs and traces, filtered and sorted by the service, chosen to be looked at or compared.

import { get, query } from "./api.js";
import { byId, fill, make, say } from "./dom.js";
import { figure } from "./figures.js";
import { complain } from "./notices.js";
import { count, duration, moment, number } from "./numbers.js";
import { RunDetail } from "./run.js";
import { drawHead, drawRow } from "./table.js";
import { verdictOf } from "./verdict.js";

/** @typedef {import("./live.js").Live} Live */

/**
 * @typedef {object} Row
 * @property {string} id
 * @property {string} kind
 * @property {string} time
 * @property {string} name
 * @property {string | null} device
 * @property {string | null} serial
 * @property {string | null} bench
 * @property {string | null} verdict
 * @property {Record<string, string> | null} parts
 * @property {Record<string, string>} against parts that speak against it, and why
 * @property {number | null} seconds
 * @property {string | null} clock
 * @property {string | null} link
 * @property {string | null} note
 * @property {string[]} tags
 * @property {Record<string, any>} figures
 * @property {string} state running, done, interrupted, recorded, unreadable
 */

const VERDICTS = ["good", "failed", "unsafe", "interrupted", "adequate", "explained", "partly explained", "unexplained"];
const PAGE = 100;

export class Runs {
  title = "Runs";

  /** @param {Live} live */
  constructor(live) {
    this.filter = byId("filter", HTMLFormElement);
    this.table = byId("runs-table", HTMLTableElement);
    this.body = this.table.tBodies[0];
    this.more = byId("runs-more", HTMLButtonElement);
    this.compare = byId("compare", HTMLButtonElement);
    this.sort = "-time";
    /** @type {string | null} */
    this.next = null;
    /** @type {Set<string>} */
    this.chosen = new Set();
    /** @type {string} */
    this.open = "";
    this.shown = false;
    /** @type {AbortController | null} */
    this.asked = null;
    this.detail = new RunDetail(live, () => this.load());
    /** @type {import("./table.js").Column<Row>[]} */
    this.columns = [
      { title: "compare", quiet: true, cell: (row) => this.choice(row) },
      { title: "time", sort: "time", cell: (row) => make("span", { class: "moment" }, moment(row.time)) },
      { title: "name", sort: "name", heads: true, cell: (row) => make("a", { href: `#/runs/${encodeURIComponent(row.id)}` }, row.name || row.id) },
      { title: "kind", sort: "kind", cell: (row) => row.kind, optional: true },
      { title: "device", sort: "device", cell: (row) => row.device ?? "–", optional: true },
      { title: "verdict", sort: "verdict", cell: (row) => verdictOf(row) },
      { title: "U of the angle", sort: "angle_expanded_rad", figure: true, optional: true, cell: (row) => figure("angle_expanded_rad", row.figures?.angle_expanded_rad) },
      { title: "residual / floor", sort: "residual_ratio", figure: true, optional: true, cell: (row) => number(ratioOf(row), 3) },
      { title: "length", sort: "seconds", figure: true, optional: true, cell: (row) => duration(row.seconds) },
      { title: "tags", cell: (row) => make("span", {}, ...(row.tags ?? []).map((tag) => make("span", { class: "tag" }, tag))), optional: true },
    ];
    const verdicts = /** @type {HTMLSelectElement} */ (this.filter.elements.namedItem("verdict"));
    verdicts.append(...VERDICTS.map((verdict) => make("option", {}, verdict)));
    let waiting = 0;
    this.filter.addEventListener("input", () => {
      clearTimeout(waiting);
      waiting = setTimeout(() => this.load(), 200);
    });
    this.filter.addEventListener("submit", (event) => event.preventDefault());
    this.more.addEventListener("click", () => this.load(this.next));
    this.compare.addEventListener("click", () => (location.hash = `#/compare/${[...this.chosen].map(encodeURIComponent).join("/")}`));
    for (const kind of ["run", "runs"]) live.on(kind, () => this.shown && this.load());
    live.on("service", ({ up }) => up && this.shown && this.load());
  }

  /** @param {string} [id] */
  show(id = "") {
    this.shown = true;
    this.open = id;
    this.load();
    this.devices();
    this.detail.show(id);
  }

  hide() {
    this.shown = false;
  }

  async devices() {
    const select = /** @type {HTMLSelectElement} */ (this.filter.elements.namedItem("serial"));
    try {
      const devices = await get("/api/devices");
      const chosen = select.value;
      fill(select, make("option", { value: "" }, "any"), ...devices.map((/** @type {any} */ one) => make("option", { value: one.serial }, one.device ? `${one.device} ${one.serial}` : one.serial)));
      select.value = chosen;
    } catch (error) {
      complain(error);
    }
  }

  /** @param {string | null} [after] cursor of the rows that follow those that are there */
  async load(after = null) {
    this.asked?.abort();
    this.asked = new AbortController();
    const asked = Object.fromEntries([...new FormData(this.filter)].map(([name, value]) => [name, String(value)]));
    try {
      const page = await get(`/api/runs${query({ ...asked, sort: this.sort, limit: PAGE, after })}`, this.asked.signal);
      this.next = page.next;
      this.draw(page.runs, Boolean(after));
      const filtered = Object.values(asked).some(Boolean);
      say(byId("runs-total"), `${count(page.total)} ${filtered ? "found" : "in the folder"}`);
      const none = byId("runs-none");
      none.hidden = page.total > 0;
      say(none, filtered ? "No run fits this filter." : "No run yet. Start one on the bench, or with hil run.");
    } catch (error) {
      complain(error);
    }
  }

  /** @param {Row[]} rows @param {boolean} more */
  draw(rows, more) {
    drawHead(this.table, this.columns, {
      by: () => this.sort,
      onSort: (by) => {
        this.sort = by;
        this.load();
      },
    });
    const drawn = rows.map((row) => drawRow(this.columns, row, { class: "row", "aria-selected": row.id === this.open ? "true" : undefined, data: { id: row.id } }));
    for (const [i, row] of drawn.entries()) {
      row.addEventListener("click", (event) => {
        if (!(/** @type {HTMLElement} */ (event.target).closest("a, input"))) location.hash = `#/runs/${encodeURIComponent(rows[i].id)}`;
      });
    }
    if (more) this.body.append(...drawn);
    else fill(this.body, ...drawn);
    this.more.hidden = !this.next;
    this.mark();
  }

  /** @param {Row} row */
  choice(row) {
    const box = make("input", { type: "checkbox", checked: this.chosen.has(row.id), "aria-label": `Compare ${row.name || row.id}` });
    box.addEventListener("change", () => {
      if (box.checked) this.chosen.add(row.id);
      else this.chosen.delete(row.id);
      if (this.chosen.size > 2) this.chosen.delete([...this.chosen][0]);
      this.mark();
    });
    return box;
  }

  mark() {
    this.compare.disabled = this.chosen.size !== 2;
    for (const row of this.body.rows) {
      const chosen = this.chosen.has(row.dataset.id ?? "");
      row.classList.toggle("chosen", chosen);
      const box = row.querySelector("input");
      if (box) box.checked = chosen;
    }
  }
}

/** @param {any} figure as a row of a list has it, or with its unit @returns {number | null} */
export const valueOf = (figure) => (typeof figure === "object" && figure !== null ? figure.value : (figure ?? null));

/** @param {any} row @returns {number | null} residual over noise floor */
export function ratioOf(row) {
  return valueOf(row.figures?.residual_ratio);
}
