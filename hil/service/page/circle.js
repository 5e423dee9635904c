// The circle: a run, a trace of what its model lacks, the effect added to the bench file, a run with it. Where one is in
// it is kept with the tab, so that a page that was loaded anew goes on.

import { get, send } from "./api.js";
import { byId, fill, make } from "./dom.js";
import { complain, doing } from "./notices.js";
import { duration, number, quantity } from "./numbers.js";
import { ratioOf, valueOf } from "./runs.js";
import { effectsOf, verdictOf, word } from "./verdict.js";

/** @typedef {import("./live.js").Live} Live */
/** @typedef {import("./board.js").Board} Board */

const KEPT = "gyrohil.circle";

/**
 * @typedef {object} Where
 * @property {string} [bench] as first run
 * @property {string} [run]
 * @property {string} [job] that traces it
 * @property {string} [trace]
 * @property {string} [better] the bench file with what was found
 * @property {string} [again] the run with it
 */

export class Circle {
  /** @param {Live} live @param {import("./board.js").BoardState} state @param {import("./controls.js").Controls} controls */
  constructor(live, state, controls) {
    this.state = state;
    this.controls = controls;
    this.panel = byId("circle");
    this.steps = byId("circle-steps");
    /** @type {Where} */
    this.where = JSON.parse(sessionStorage.getItem(KEPT) ?? "{}");
    /** @type {Record<string, any>} runs and diagnoses by id */
    this.known = {};
    /** @type {any} */
    this.job = null;
    state.listen((board, _, before) => this.hear(board, before));
    live.on("job", (job) => this.hearJob(job));
    live.on("run", (row) => this.hearRun(row));
    live.on("service", ({ up }) => up && this.resume());
  }

  /** @param {Where} where */
  keep(where) {
    this.where = where;
    sessionStorage.setItem(KEPT, JSON.stringify(where));
    this.draw();
  }

  async resume() {
    const { run, trace, again, job } = this.where;
    await Promise.all([run, again].map((id) => id && this.learn(id)));
    if (trace) await this.diagnosis(trace);
    else if (job) await get(`/api/jobs/${encodeURIComponent(job)}`).then((row) => this.hearJob(row), () => null);
    this.draw();
  }

  /** @param {Board} board @param {Board} before */
  hear(board, before) {
    if (board.runId && board.runId !== before.runId) {
      const bench = this.controls.benches.value;
      const next = this.where.better && bench === this.where.better && this.where.run !== board.runId;
      if (next) this.keep({ ...this.where, again: board.runId });
      else if (this.where.run !== board.runId && this.where.again !== board.runId) this.keep({ bench, run: board.runId });
    }
    // a page that was not there meanwhile: the run that ended last
    if (!board.running && board.lastRun && !this.where.run) this.adopt(board.lastRun, board.bench);
    if (before.runId && !board.runId) this.draw(); // the service tells of its result
    if (board.running && board.stage !== before.stage) this.draw();
  }

  /** @param {string} run @param {string} bench */
  adopt(run, bench) {
    this.keep({ bench, run });
    this.learn(run).then(() => this.draw());
  }

  /** @param {any} row */
  hearRun(row) {
    if (row.id === this.where.run || row.id === this.where.again) this.learn(row.id).then(() => this.draw());
  }

  /** @param {any} job */
  hearJob(job) {
    if (job.id !== this.where.job) return;
    this.job = job;
    const trace = job.result?.run;
    if (job.state === "done" && trace && !this.where.trace) this.diagnosis(trace).then(() => this.keep({ ...this.where, trace }));
    else this.draw();
  }

  /** @param {string} id */
  async learn(id) {
    this.known[id] = await get(`/api/runs/${encodeURIComponent(id)}`).catch(() => this.known[id]);
  }

  /** @param {string} id */
  async diagnosis(id) {
    this.known[id] = await get(`/api/runs/${encodeURIComponent(id)}/diagnosis`).catch((error) => complain(error));
  }

  draw() {
    const { run, trace, better, again } = this.where;
    this.panel.hidden = !run || this.state.now.runId === run;
    if (this.panel.hidden || !run) return;
    const steps = [this.runStep("Run", run), this.traceStep(), this.addStep(), this.againStep()];
    const at = again ? 3 : better ? 3 : trace ? 2 : this.ended(run) ? 1 : 0;
    const focused = document.activeElement?.id;
    fill(this.steps, ...steps.map((step, i) => {
      if (i === at) step.setAttribute("aria-current", "step");
      return step;
    }));
    if (focused) document.getElementById(focused)?.focus();
  }

  /** @param {string} id */
  ended(id) {
    return Boolean(this.known[id]?.verdict) && this.state.now.runId !== id;
  }

  /** @param {string} title @param {string} id */
  runStep(title, id) {
    const row = this.known[id];
    const link = make("a", { href: `#/runs/${encodeURIComponent(id)}` }, "report and files");
    if (this.state.now.runId === id) return step(title, make("p", {}, this.state.now.stage && this.state.now.stage !== "run" ? `${this.state.now.stage} …` : "running"));
    if (!row?.verdict) return step(title, make("p", {}, row?.state === "interrupted" ? "interrupted" : "no result yet"));
    return step(title, make("p", {}, verdictOf(row, { reasons: true })), make("p", {}, link));
  }

  traceStep() {
    const { run, trace, job } = this.where;
    const ready = run && this.ended(run);
    const found = trace && this.known[trace];
    if (found) {
      return step(
        "Trace",
        make("p", {}, word(found.verdict), found.held_out?.before ? `. Residual over floor ${number(found.held_out.before.ratio, 3)} → ${number(found.held_out.after?.ratio, 3)} on what the choice never saw` : ""),
        ...effectsOf(found),
      );
    }
    if (job && this.job && (this.job.state === "queued" || this.job.state === "running")) {
      const { done, total, left_s: left, stage } = this.job;
      return step("Trace", make("progress", { max: 1, ...(total ? { value: done / total } : {}), "aria-label": "Progress of the trace" }), make("p", {}, `${stage ?? this.job.state}${left ? `, ${duration(left)} left` : ""}`), button("circle-cancel", "Cancel", () => send("DELETE", `/api/jobs/${encodeURIComponent(job)}`)));
    }
    if (this.job?.state === "failed") return step("Trace", make("p", { class: "word bad" }, this.job.error ?? "failed"), this.traceButton());
    return step("Trace", make("p", {}, "What does the model lack?"), ready && this.traceButton());
  }

  traceButton() {
    return button("circle-trace", "Trace this run", async () => {
      this.job = await send("POST", "/api/jobs", { kind: "trace", run: this.where.run });
      this.keep({ ...this.where, job: this.job.id });
    });
  }

  addStep() {
    const { trace, better, bench } = this.where;
    if (better) return step("Add", make("p", {}, "In the bench file ", make("code", {}, better)));
    const found = trace && this.known[trace];
    if (!found) return step("Add", make("p", {}, "What was found goes into the bench file."));
    if (!found.effects?.length) return step("Add", make("p", {}, "Nothing to add."));
    return step("Add", make("p", {}, `${found.effects.length === 1 ? "One effect" : `${found.effects.length} effects`} to add to `, make("code", {}, bench ?? "")), button("circle-add", "Add to the bench file", async () => {
      const answer = await send("POST", `/api/benches/${encodeURIComponent(bench ?? "")}/effects`, { trace });
      this.keep({ ...this.where, better: answer.name });
      await this.controls.load(this.where.better);
    }));
  }

  againStep() {
    const { run, better, again } = this.where;
    if (!better) return step("Run again", make("p", {}, "With what was found, estimated and compensated."));
    if (again && (!this.ended(again) || !run)) return this.runStep("Run again", again);
    if (again && run) {
      const [before, after] = [this.known[run], this.known[again]];
      const rows = /** @type {[string, number | null, number | null, string][]} */ ([
        ["angle error", valueOf(before.figures?.angle_error_rms_rad), valueOf(after.figures?.angle_error_rms_rad), "rad"],
        ["U of the angle", valueOf(before.figures?.angle_expanded_rad), valueOf(after.figures?.angle_expanded_rad), "rad"],
        ["residual / floor", ratioOf(before), ratioOf(after), ""],
      ]).filter(([, left, right]) => left || right);
      return step("Run again", make("p", {}, verdictOf(after, { reasons: true })), ...rows.map(([name, left, right, unit]) => make("p", {}, `${name} ${quantity(left, unit)} → ${quantity(right, unit)}`)), make("p", {}, make("a", { href: `#/compare/${encodeURIComponent(run)}/${encodeURIComponent(again)}` }, "Side by side")), this.againButton());
    }
    return step("Run again", make("p", {}, "The same board, with the better model."), this.againButton());
  }

  againButton() {
    return button("circle-again", "Arm and run …", async () => {
      await this.controls.load(this.where.better);
      await this.controls.armAndStart();
    });
  }
}

/** @param {string} title @param {...(Node | false | undefined | "")} content */
function step(title, ...content) {
  return make("li", {}, make("h3", {}, title), ...content);
}

/** @param {string} id @param {string} text @param {() => Promise<unknown>} act */
function button(id, text, act) {
  return make("button", { type: "button", id, onclick: doing(act) }, text);
}
