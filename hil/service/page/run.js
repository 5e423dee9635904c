// One run: verdict, figures, tags, note, files, report, its traces; and what can be done with it.

import { get, send } from "./api.js";
import { shortened } from "./board.js";
import { byId, fill, make } from "./dom.js";
import { figure, nameOf } from "./figures.js";
import { complain, doing, notice } from "./notices.js";
import { duration, moment, uncertain } from "./numbers.js";
import { ticketFor } from "./ticket.js";
import { effectsOf, partsOf, toneOf, word } from "./verdict.js";

/** @typedef {import("./live.js").Live} Live */

export class RunDetail {
  /**
   * @param {Live} live
   * @param {() => void} onChange where the list has to be loaded again
   */
  constructor(live, onChange) {
    this.host = byId("run");
    this.onChange = onChange;
    this.id = "";
    live.on("run", (row) => row.id === this.id && !this.host.contains(document.activeElement) && this.load());
  }

  /** @param {string} id "" for none */
  show(id) {
    const other = id !== this.id;
    this.id = id;
    this.host.hidden = !id;
    if (id && (other || !this.host.hasChildNodes())) this.load();
  }

  async load() {
    const id = this.id;
    try {
      const path = `/api/runs/${encodeURIComponent(id)}`;
      const run = await get(path);
      const there = (/** @type {string} */ name) => run.files.some((/** @type {any} */ file) => file.name === `${name}.json`);
      const what = ["diagnosis", "result"].find(there);
      const more = what ? await get(`${path}/${what}`) : {};
      if (id === this.id) this.draw(run, more);
    } catch (error) {
      fill(this.host, make("p", { class: "note" }, "This run cannot be shown."));
      complain(error);
    }
  }

  /** @param {any} run @param {any} more its result.json or diagnosis.json */
  draw(run, more) {
    const path = `/api/runs/${encodeURIComponent(run.id)}`;
    const tone = toneOf(run.verdict);
    const frame = make("div", {});
    const facts = Object.entries({ device: run.device, serial: run.serial, bench: run.bench, link: shortened(run.link ?? ""), clock: run.clock, time: moment(run.time), length: duration(run.seconds) })
      .filter(([, value]) => value && value !== "–")
      .flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, String(value))]);
    const figures = Object.entries(run.figures ?? {}).map(([name, told]) => make("tr", {}, make("th", { scope: "row" }, nameOf(name)), make("td", { class: "n" }, withSpread(name, told))));
    const traces = run.traces ?? [];
    fill(
      this.host,
      make("div", { class: "head" }, make("h2", {}, run.name || run.id), make("a", { href: "#/runs" }, "Close")),
      make("p", { class: `verdict ${tone}` }, word(run.verdict ?? run.state), run.reasons?.length ? `. ${run.reasons.join("; ")}` : ""),
      run.kind === "run" && partsOf(more.parts ?? run.parts),
      ...effectsOf(more),
      make(
        "div",
        { class: "actions" },
        run.files.some((/** @type {any} */ file) => file.name === "report.html") && make("button", { type: "button", onclick: doing(() => this.report(path, frame)) }, "Report"),
        run.kind === "run" && make("button", { type: "button", onclick: doing(() => this.job("trace", run)) }, "Trace"),
        run.kind === "run" && make("button", { type: "button", onclick: doing(() => this.job("replay", run)) }, "Replay"),
        make("button", { type: "button", onclick: doing(() => this.remove(run)) }, "Delete"),
      ),
      run.unreadable && make("p", { class: "word bad" }, run.unreadable),
      frame,
      make("h3", {}, "Tags"),
      this.tags(run, path),
      make("h3", {}, make("label", { for: "run-note" }, "Note")),
      this.note(run, path),
      make("h3", {}, "About"),
      make("dl", { class: "facts" }, ...facts),
      traces.length > 0 && make("h3", {}, "Traces of it"),
      traces.length > 0 && make("ul", { class: "files" }, ...traces.map((/** @type {any} */ trace) => make("li", {}, make("a", { href: `#/runs/${encodeURIComponent(trace.id)}` }, trace.name || trace.id), " ", word(trace.verdict)))),
      figures.length > 0 && make("h3", {}, "Figures"),
      make("table", {}, make("caption", { class: "quiet" }, "Figures of the run"), make("tbody", {}, ...figures)),
      make("h3", {}, "Files"),
      make("ul", { class: "files" }, ...(run.files ?? []).map((/** @type {any} */ file) => this.file(path, file))),
    );
  }

  /** @param {string} path @param {any} file */
  file(path, file) {
    const { name } = file;
    const save = doing(async () => {
      const link = make("a", { href: await ticketFor(`${path}/files/${encodeURIComponent(name)}`), download: name });
      link.click();
    });
    return make("li", {}, make("button", { type: "button", class: "plain", onclick: save }, name), make("span", { class: "aside" }, bytes(file.bytes)));
  }

  /** @param {string} path @param {HTMLElement} host */
  async report(path, host) {
    if (host.hasChildNodes()) return fill(host);
    const address = await ticketFor(`${path}/report`);
    fill(host, make("iframe", { class: "report", title: "Report of the run", src: address, sandbox: "" }));
    host.scrollIntoView({ block: "nearest" });
  }

  /** @param {string} kind @param {any} run */
  async job(kind, run) {
    await send("POST", "/api/jobs", { kind, run: run.id });
    notice(`${kind === "trace" ? "Tracing" : "Replaying"} ${run.name || run.id}`, { action: { label: "Jobs", act: () => (location.hash = "#/jobs") } });
  }

  /** @param {any} run */
  async remove(run) {
    const path = `/api/runs/${encodeURIComponent(run.id)}`;
    await send("DELETE", path);
    location.hash = "#/runs";
    this.onChange();
    const restore = () => send("POST", `${path}/restore`).then(() => this.onChange(), complain);
    notice(`${run.name || run.id} is in the trash`, { action: { label: "Undo", act: restore } });
  }

  /** @param {any} run @param {string} path */
  tags(run, path) {
    const host = make("div", {});
    const change = async (/** @type {string[]} */ tags) => {
      await send("PATCH", path, { tags });
      run.tags = tags;
      draw();
      this.onChange();
    };
    const draw = () => {
      const input = make("input", { size: 10, "aria-label": "New tag", placeholder: "new tag" });
      const add = make("form", { class: "inline" }, input, make("button", { type: "submit" }, "Add"));
      add.addEventListener("submit", doing(async () => {
        const tag = input.value.trim();
        if (!tag || run.tags?.includes(tag)) return;
        await change([...(run.tags ?? []), tag]);
        host.querySelector("input")?.focus();
      }));
      const tags = (run.tags ?? []).map((/** @type {string} */ tag) =>
        make("span", { class: "tag" }, tag, make("button", { type: "button", "aria-label": `Remove tag ${tag}`, onclick: doing(() => change(run.tags.filter((/** @type {string} */ other) => other !== tag))) }, "×")));
      fill(host, ...tags, add);
    };
    draw();
    return host;
  }

  /** @param {any} run @param {string} path */
  note(run, path) {
    const text = make("textarea", { id: "run-note", value: run.note ?? "" });
    text.addEventListener("change", doing(async () => {
      await send("PATCH", path, { note: text.value });
      notice("Note kept", { tone: "good" });
      this.onChange();
    }));
    return text;
  }
}

/** @param {string} name @param {{ value: number, unit: string, u: number | null }} told @returns {string} */
function withSpread(name, { value, unit, u }) {
  if (u === null || u === undefined) return figure(name, value, unit);
  const written = uncertain(value, u, unit);
  return `${written.value} ± ${written.spread} ${written.unit}`;
}

/** @param {number} count @returns {string} */
function bytes(count) {
  if (count < 1e3) return `${count} B`;
  return count < 1e6 ? `${(count / 1e3).toFixed(0)} kB` : `${(count / 1e6).toFixed(1)} MB`;
}
