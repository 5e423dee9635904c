// The service's requests for people, made from openapi.json: nothing is loaded from elsewhere.

import { byId, fill, make } from "../dom.js";

/** @typedef {Record<string, any>} Schema */

/** @type {Record<string, Schema>} */
let schemas = {};

/** @param {Schema} [schema] @returns {Schema} what a reference leads to */
const resolved = (schema = {}) => (schema.$ref ? (schemas[schema.$ref.split("/").pop() ?? ""] ?? {}) : schema);

/** @param {Schema} schema @returns {string} its type, short */
function typeOf(schema) {
  const own = resolved(schema);
  const several = own.anyOf ?? own.oneOf;
  if (several) return several.map(typeOf).filter((/** @type {string} */ type) => type !== "null").join(" or ");
  if (own.enum) return own.enum.map((/** @type {unknown} */ one) => JSON.stringify(one)).join(" or ");
  if (own.const !== undefined) return JSON.stringify(own.const);
  if (own.type === "array") return `list of ${typeOf(own.items ?? {})}`;
  const bounds = [["minimum", "≥"], ["exclusiveMinimum", ">"], ["maximum", "≤"], ["exclusiveMaximum", "<"]].flatMap(([key, sign]) => (own[key] === undefined ? [] : [`${sign} ${own[key]}`]));
  if (own.maxLength) bounds.push(`at most ${own.maxLength} characters`);
  return [own.type ?? own.title ?? "any", bounds.join(", ")].filter(Boolean).join(", ");
}

/** @param {[string, string, string][]} rows @param {string} caption */
function table(rows, caption) {
  if (!rows.length) return false;
  return make("table", {}, make("caption", {}, caption), make("tbody", {}, ...rows.map(([name, type, words]) => make("tr", {}, make("th", { scope: "row" }, make("code", {}, name)), make("td", {}, type), make("td", {}, words)))));
}

/** @param {Schema} schema @returns {[string, string, string][]} the fields of a body; of several kinds, of each */
function fieldsOf(schema) {
  const own = resolved(schema);
  const several = own.oneOf ?? own.anyOf;
  if (several) return several.flatMap(fieldsOf);
  const needed = new Set(own.required ?? []);
  return Object.entries(own.properties ?? {}).map(([name, field]) => {
    const otherwise = needed.has(name) ? "needed" : field.default !== undefined && field.default !== null ? `default ${JSON.stringify(field.default)}` : "";
    return [name, typeOf(field), [otherwise, field.description ?? ""].filter(Boolean).join("; ")];
  });
}

/** @param {string} path @param {string} method @param {any} request */
function section(path, method, request) {
  const id = `${method}${path}`.replaceAll(/[^a-z0-9]+/gi, "-");
  const parameters = (request.parameters ?? []).map((/** @type {any} */ one) => [one.name, `${one.in}, ${typeOf(one.schema)}`, [one.required && "needed", one.description ?? one.schema?.description].filter(Boolean).join("; ")]);
  const bodies = Object.entries(request.requestBody?.content ?? {});
  const answers = Object.entries(request.responses ?? {}).filter(([status]) => status.startsWith("2"));
  return {
    link: make("li", {}, make("a", { href: `#${id}` }, `${method.toUpperCase()} ${path}`)),
    shown: make(
      "section",
      { id, class: "panel", "aria-labelledby": `${id}-h` },
      make("h2", { id: `${id}-h` }, make("code", {}, `${method.toUpperCase()} ${path}`)),
      make("p", {}, request.description ?? request.summary ?? ""),
      table(parameters, "Parameters"),
      ...bodies.map(([type, { schema }]) => table(fieldsOf(schema), `Body, ${type}`)),
      make("p", { class: "note" }, `Answers ${answers.map(([status]) => status).join(", ")}.`),
    ),
  };
}

const answer = await fetch("../openapi.json");
const description = await answer.json();
schemas = description.components?.schemas ?? {};
const sections = Object.entries(description.paths).flatMap(([path, methods]) => Object.entries(methods).map(([method, request]) => section(path, method, request)));
fill(byId("contents"), make("ul", {}, ...sections.map(({ link }) => link)));
fill(byId("requests"), ...sections.map(({ shown }) => shown));
