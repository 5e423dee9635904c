// Long work: what runs, how far it is, how long it still takes, what came of it.

import { get, send } from "./api.js";
import { byId, fill, make } from "./dom.js";
import { complain, doing, notice } from "./notices.js";
import { duration, moment } from "./numbers.js";
import { drawHead, drawRow } from "./table.js";
import { ticketFor } from "./ticket.js";
import { verdictOf } from "./verdict.js";

/**
 * @typedef {object} Job
 * @property {string} id
 * @property {string} kind
 * @property {"queued" | "running" | "done" | "failed" | "cancelled"} state
 * @property {string | null} stage
 * @property {number | null} done
 * @property {number | null} total
 * @property {number | null} left_s
 * @property {string | null} error
 * @property {any} result
 * @property {string | null} began
 * @property {string | null} by
 */

/** @param {Record<string, number>} outcomes @returns {string} 34 ran, 2 failed */
const tally = (outcomes) => Object.entries(outcomes ?? {}).map(([outcome, count]) => `${count} ${outcome}`).join(", ");

export class Jobs {
  title = "Jobs";

  /** @param {import("./live.js").Live} live */
  constructor(live) {
    this.table = byId("jobs-table", HTMLTableElement);
    /** @type {Map<string, Job>} */
    this.jobs = new Map();
    /** @type {import("./table.js").Column<Job>[]} */
    this.columns = [
      { title: "work", heads: true, cell: (job) => job.kind },
      { title: "state", cell: (job) => job.state },
      { title: "progress", cell: (job) => this.progress(job) },
      { title: "left", figure: true, cell: (job) => (job.state === "running" ? duration(job.left_s) : "") },
      { title: "began", optional: true, cell: (job) => moment(job.began) },
      { title: "by", optional: true, cell: (job) => job.by ?? "" },
      { title: "what can be done", quiet: true, cell: (job) => this.actions(job) },
    ];
    live.on("job", (job) => this.hear(job));
    live.on("service", ({ up }) => up && this.load());
    this.frame = byId("job-report");
    const sweep = byId("sweep", HTMLFormElement);
    sweep.addEventListener("submit", doing(async () => {
      await send("POST", "/api/jobs", { kind: "sweep", campaign: byId("campaign", HTMLSelectElement).value });
      notice("The campaign is at work", { tone: "good" });
    }));
    const upload = byId("upload", HTMLFormElement);
    upload.addEventListener("submit", doing(async () => {
      const form = new FormData(upload);
      const map = /** @type {File} */ (form.get("map"));
      if (!map?.name) form.delete("map");
      const uploaded = await send("POST", "/api/uploads", form);
      await send("POST", "/api/jobs", { kind: "import", upload: uploaded.id });
      upload.reset();
      notice("Importing the record", { tone: "good" });
    }));
  }

  show() {
    this.load();
  }

  async load() {
    try {
      const [{ jobs }, { campaigns }] = await Promise.all([get("/api/jobs"), get("/api/campaigns")]);
      const select = byId("campaign", HTMLSelectElement);
      const { value } = select;
      fill(select, ...campaigns.map((/** @type {string} */ name) => make("option", { value: name, selected: name === value }, name)));
      this.jobs = new Map(jobs.map((/** @type {Job} */ job) => [job.id, job]));
      this.draw();
    } catch (error) {
      complain(error);
    }
  }

  /** @param {Job} job */
  hear(job) {
    this.jobs.set(job.id, job);
    this.draw();
  }

  draw() {
    const jobs = [...this.jobs.values()].sort((a, b) => String(b.began ?? "~").localeCompare(String(a.began ?? "~")));
    const running = jobs.filter((job) => job.state === "running" || job.state === "queued").length;
    const count = byId("jobs-running");
    count.hidden = running === 0;
    fill(count, String(running), make("span", { class: "quiet" }, " at work"));
    if (byId("view-jobs").hidden) return;
    const focused = document.activeElement?.id;
    drawHead(this.table, this.columns);
    fill(this.table.tBodies[0], ...jobs.map((job) => drawRow(this.columns, job)));
    if (focused) document.getElementById(focused)?.focus();
    byId("jobs-none").hidden = jobs.length > 0;
    byId("jobs-none").textContent = "Nothing has been asked for yet. Traces, replays, imports and campaigns appear here.";
  }

  /** @param {Job} job */
  progress(job) {
    if (job.state === "running") {
      const known = job.total && job.done !== null;
      return make("span", {}, make("progress", { max: 1, ...(known ? { value: /** @type {number} */ (job.done) / /** @type {number} */ (job.total) } : {}), "aria-label": `Progress of ${job.kind}` }), " ", job.stage ?? "");
    }
    if (job.state === "failed") return make("span", { class: "word bad" }, job.error ?? "failed");
    if (job.result?.campaign) return make("span", {}, `${job.result.campaign}: ${tally(job.result.outcomes)}`);
    return make("span", {}, job.result?.verdict ? verdictOf(job.result, { reasons: true }) : (job.error ?? ""));
  }

  /** The page of a campaign, below the table; once more takes it away. @param {Job} job */
  async report(job) {
    const shown = this.frame.dataset.job === job.id;
    this.frame.dataset.job = shown ? "" : job.id;
    if (shown) return fill(this.frame);
    const address = await ticketFor(`/api/jobs/${job.id}/report`);
    fill(this.frame, make("iframe", { class: "report", title: `Report of the campaign ${job.result.campaign}`, src: address, sandbox: "" }));
    this.frame.scrollIntoView({ block: "nearest" });
    return undefined;
  }

  /** @param {Job} job */
  actions(job) {
    const id = job.result?.run;
    if (job.state === "running" || job.state === "queued") return make("button", { type: "button", id: `cancel-${job.id}`, onclick: doing(() => send("DELETE", `/api/jobs/${job.id}`)) }, "Cancel");
    if (job.result?.campaign) return make("button", { type: "button", id: `report-${job.id}`, onclick: doing(() => this.report(job)) }, "Report");
    return id ? make("a", { href: `#/runs/${encodeURIComponent(id)}` }, "Open") : null;
  }
}
