// What is known of the board: the newest state that the service told, in one shape for all who show it.

/** @typedef {import("./live.js").Live} Live */

/**
 * @typedef {object} RunNow what the loop says of itself, several times a second
 * @property {number} t_s bench time
 * @property {number} elapsed_s of it since the run began
 * @property {number | null} [angle_rad]
 * @property {number | null} [angle_u_rad] standard uncertainty, k = 1
 * @property {number | null} [angle_expanded_rad] expanded uncertainty, k = 2
 * @property {number | null} [rate_rad_s]
 * @property {number | null} [rate_u]
 * @property {Record<string, [number, number | null, string]>} [estimates] value, standard deviation (null: not given), unit
 */

/**
 * @typedef {object} Board
 * @property {boolean} connected
 * @property {boolean} lost it does not answer any more
 * @property {boolean} left it is not lost, but has ended with a run in lockstep
 * @property {string} link "" where none was chosen
 * @property {string} bench
 * @property {Record<string, any>} identity
 * @property {string} state of the board, as in docs/safety.md
 * @property {string} reason
 * @property {string} words what there is to say about it
 * @property {string | null} runId of the run that lasts
 * @property {string | null} lastRun of the one before
 * @property {RunNow | null} ended what that one said of itself last
 * @property {RunNow | null} run
 * @property {number | null} seconds that it is to last
 * @property {string} stage of the run, "" for none
 * @property {number} done of `total`
 * @property {number} total
 * @property {boolean} running
 * @property {{ holder: string, purpose?: string, until?: string } | null} lease
 * @property {Record<string, number>} settings in force
 * @property {Record<string, number>} nextSettings that wait for the next start
 * @property {Record<string, any>} health
 */

/** @param {any} said @returns {Board} */
export function readBoard(said) {
  const runId = said.run ?? null;
  const stage = said.stage ?? "";
  return {
    connected: Boolean(said.connected),
    lost: Boolean(said.lost),
    left: Boolean(said.left),
    link: shortened(said.link ?? ""),
    bench: said.bench ?? "",
    identity: said.identity ?? {},
    state: said.state ?? "",
    reason: said.reason ?? "",
    words: said.words ?? "",
    runId,
    lastRun: said.last_run ?? null,
    ended: said.ended && said.ended.run === said.last_run ? said.ended : null,
    run: said.now ?? null,
    seconds: said.duration_s ?? null,
    stage,
    done: said.done ?? 0,
    total: said.total ?? 0,
    running: Boolean(runId || stage),
    lease: said.lease ?? null,
    settings: said.settings ?? {},
    nextSettings: said.next_settings ?? {},
    health: said.health ?? {},
  };
}

/** @param {string} link @returns {string} an emulated board by the name of its scenario, as one would write it */
export function shortened(link) {
  const match = link.match(/^(pty|inproc):.*?([^/]+?)(\.scenario\.toml)?$/);
  return match ? `${match[1]}:${match[2]}` : link;
}

export const NO_BOARD = readBoard({});

/** The newest state, and who wants to hear of it. */
export class BoardState {
  /** @param {Live} live */
  constructor(live) {
    this.now = NO_BOARD;
    this.up = false;
    /** @type {((board: Board, up: boolean, before: Board) => void)[]} */
    this.listeners = [];
    live.on("state", (said) => this.tell(readBoard(said), true));
    live.on("service", ({ up }) => this.tell(this.now, up));
  }

  /** @param {Board} board @param {boolean} up */
  tell(board, up) {
    const before = this.now;
    this.now = board;
    this.up = up;
    for (const listener of this.listeners) listener(board, up, before);
  }

  /** @param {(board: Board, up: boolean, before: Board) => void} listener */
  listen(listener) {
    this.listeners.push(listener);
    listener(this.now, this.up, this.now);
  }
}
