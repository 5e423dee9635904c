// The bench: the board that is connected, live, and what can be done with it.

import { get, query } from "./api.js";
import { Circle } from "./circle.js";
import { Controls } from "./controls.js";
import { byId } from "./dom.js";
import { showDrive } from "./drive.js";
import { showTrims } from "./trims.js";
import { EstimatesTable } from "./estimates.js";
import { showHealth } from "./health.js";
import { Innovation } from "./innovation.js";
import { showLast } from "./last-run.js";
import { Motion } from "./motion.js";
import { complain } from "./notices.js";
import { Pattern } from "./pattern.js";
import { Scope } from "./scope.js";

export class Bench {
  title = "Bench";

  /** @param {import("./live.js").Live} live @param {import("./board.js").BoardState} state */
  constructor(live, state) {
    this.state = state;
    this.view = byId("view-bench");
    const controls = new Controls(live, state);
    new Circle(live, state, controls);
    this.motion = new Motion();
    this.estimates = new EstimatesTable();
    this.innovation = new Innovation(live);
    this.scope = new Scope(live);
    this.pattern = new Pattern(live);
    this.streams = [this.pattern, this.scope, this.innovation];
    /** @type {string | null} the run that is shown, or was last */
    this.seen = null;
    /** @type {string | null} */
    this.recalled = null;
    this.visible = false;
    /** @type {string | null} the run whose samples flow */
    this.flowing = null;
    state.listen((board) => this.hear(board));
    live.on("run", ({ id }) => id === this.flowing && this.recall(id));
  }

  show() {
    this.visible = true;
    this.flow();
  }

  hide() {
    this.visible = false;
    this.flow();
  }

  /** @param {import("./board.js").Board} board */
  hear({ run, health }) {
    this.view.classList.toggle("stale", !run);
    this.motion.set(run);
    this.estimates.set(run);
    this.innovation.set(run);
    showHealth(health, run);
    showDrive(/** @type {any} */ (run)?.drive);
    showTrims(/** @type {any} */ (run)?.trims);
    this.flow();
    this.last();
  }

  /** A page that was loaded after a run shows what there was to see at its end. */
  last() {
    const { up, now } = this.state;
    if (now.runId) this.seen = now.runId;
    if (!up || now.running || this.seen || !now.lastRun) return;
    const run = (this.seen = now.lastRun);
    showLast(this, run, now.ended, () => this.seen === run && !this.state.now.running).catch(complain);
  }

  /** Samples flow while a run lasts and somebody looks. */
  flow() {
    const { up, now } = this.state;
    const run = this.visible && up && now.run ? now.runId : null;
    if (run === this.flowing) return;
    if (this.flowing) for (const stream of this.streams) stream.hide();
    this.recalled = null;
    this.flowing = run;
    if (!run || !now.run) return;
    for (const stream of this.streams) stream.show(run);
    this.recallListed(run).catch(complain);
  }

  /** Of a run that the catalogue has already; of one that it has not, the service tells. @param {string} run */
  async recallListed(run) {
    const { runs } = await get(`/api/runs${query({ kind: "run", sort: "-time", limit: 10 })}`);
    if (run === this.flowing && runs.some((/** @type {{ id: string }} */ { id }) => id === run)) this.recall(run);
  }

  /** What was recorded of a run before one looked. @param {string} run */
  recall(run) {
    if (this.recalled === run && this.flowing === run) return;
    this.recalled = run;
    const asked = [this.scope.begin(run), this.motion.recall(run), this.estimates.recall(run, this.state.now.run?.t_s ?? 0)];
    for (const one of asked) one.catch(complain);
  }
}
