// A table whose columns can be sorted by.

import { fill, make } from "./dom.js";

/**
 * @template Row
 * @typedef {object} Column
 * @property {string} title
 * @property {(row: Row) => (Node | string | null)} cell
 * @property {string} [sort] what the service sorts by; not sortable where there is none
 * @property {boolean} [figure] set right, digits under digits
 * @property {boolean} [optional] left out on a phone
 * @property {boolean} [quiet] the title is not seen, only read out
 * @property {boolean} [heads] the cell that names its row
 */

/**
 * @template Row
 * @param {HTMLTableElement} table
 * @param {Column<Row>[]} columns
 * @param {object} [sorting]
 * @param {() => string} sorting.by name of what is sorted by, with a minus for falling
 * @param {(by: string) => void} sorting.onSort
 */
export function drawHead(table, columns, sorting) {
  const cells = columns.map((column) => {
    const classes = [column.figure && "n", column.optional && "optional"].filter(Boolean).join(" ");
    const { sort } = column;
    if (column.quiet) return make("th", { scope: "col" }, make("span", { class: "quiet" }, column.title));
    if (!sort || !sorting) return make("th", { scope: "col", class: classes }, column.title);
    const by = sorting.by();
    const falls = by === `-${sort}`;
    const sorted = falls ? "descending" : by === sort ? "ascending" : undefined;
    const button = make("button", { type: "button", class: "sort", onclick: () => sorting.onSort(falls ? sort : `-${sort}`) }, column.title);
    return make("th", { scope: "col", class: classes, "aria-sort": sorted }, button);
  });
  const focused = document.activeElement?.closest("thead") === table.tHead ? document.activeElement?.textContent : null;
  fill(/** @type {HTMLElement} */ (table.tHead), make("tr", {}, ...cells));
  if (focused) /** @type {HTMLElement | undefined} */ ([...table.querySelectorAll("thead button")].find((button) => button.textContent === focused))?.focus();
}

/**
 * @template Row
 * @param {Column<Row>[]} columns
 * @param {Row} row
 * @param {Record<string, any>} [properties]
 * @returns {HTMLTableRowElement}
 */
export function drawRow(columns, row, properties = {}) {
  const cells = columns.map((column) => {
    const classes = [column.figure && "n", column.optional && "optional"].filter(Boolean).join(" ");
    return make(column.heads ? "th" : "td", { class: classes, scope: column.heads ? "row" : undefined }, column.cell(row) ?? "");
  });
  return make("tr", properties, ...cells);
}
