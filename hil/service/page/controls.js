// What one does with the board: connect, arm with consent, start, stop, change settings. SAFE is apart, in safe.js.

import { get, send } from "./api.js";
import { askConsent } from "./consent.js";
import { byId, fill, make, say } from "./dom.js";
import { giveLeaseBack, takeLease } from "./lease.js";
import { complain, doing, notice } from "./notices.js";
import { duration, number, quantity } from "./numbers.js";
import { holder } from "./session.js";
import { SettingsForm } from "./settings.js";

/** @typedef {import("./board.js").Board} Board */
/** @typedef {{ name: string, error?: string, link?: string | null, duration_s?: number, settings?: Record<string, number> }} BenchFile */

const CHOSEN = "gyrohil.bench";

/** @param {number | undefined} firmware a byte for each of its three numbers @returns {string | undefined} 1.2.3 */
const versionOf = (firmware) => (firmware === undefined ? undefined : [firmware >> 16, (firmware >> 8) & 255, firmware & 255].join("."));

export class Controls {
  /** @param {import("./live.js").Live} live @param {import("./board.js").BoardState} state */
  constructor(live, state) {
    this.state = state;
    this.benches = byId("bench", HTMLSelectElement);
    this.link = byId("link", HTMLInputElement);
    this.length = byId("duration", HTMLInputElement);
    this.connect = byId("connect", HTMLButtonElement);
    this.disconnect = byId("disconnect", HTMLButtonElement);
    this.start = byId("start", HTMLButtonElement);
    this.stop = byId("stop", HTMLButtonElement);
    this.settings = new SettingsForm(state, (changed) => this.change(changed));
    /** @type {BenchFile[]} */
    this.files = [];
    byId("connect-form").addEventListener("submit", doing(() => this.connectBoard()));
    this.disconnect.addEventListener("click", doing(() => this.letGo()));
    byId("start-form").addEventListener("submit", doing(() => this.armAndStart()));
    this.stop.addEventListener("click", doing(() => send("POST", "/api/board/stop")));
    this.benches.addEventListener("change", () => {
      sessionStorage.setItem(CHOSEN, this.benches.value);
      this.chosen(true);
    });
    live.on("service", ({ up }) => up && this.load().catch(complain));
    state.listen((board, up) => this.draw(board, up));
  }

  /** The bench files there are. @param {string} [choose] the one to choose */
  async load(choose) {
    const { benches } = await get("/api/benches");
    this.files = benches;
    if (choose) sessionStorage.setItem(CHOSEN, choose);
    const kept = choose ?? sessionStorage.getItem(CHOSEN) ?? this.state.now.bench;
    // a rate sensor has no loop, and what cannot be read says why
    fill(this.benches, ...this.files.map((file) => make("option", { value: file.name, disabled: !file.settings, title: file.error ?? "" }, file.name)));
    if (kept && this.files.some((file) => file.name === kept)) this.benches.value = kept;
    this.chosen(Boolean(choose) && !this.state.now.connected);
    const links = [...new Set(this.files.flatMap((file) => file.link ?? []))];
    fill(byId("links"), ...links.map((link) => make("option", { value: link })));
  }

  /** @returns {BenchFile | undefined} */
  get file() {
    return this.files.find((file) => file.name === this.benches.value);
  }

  /** @param {boolean} anew whether its link and length take the place of what stands there */
  chosen(anew) {
    const { file } = this;
    if (!file) return;
    if (!this.state.now.connected && (anew || !this.link.value)) this.link.value = file.link ?? "";
    if (anew || !this.length.value) this.length.value = file.duration_s ? String(file.duration_s) : "";
    this.settings.declare(file.settings ?? {});
  }

  async connectBoard() {
    await takeLease();
    say(this.connect, "Connecting …");
    try {
      await send("POST", "/api/board/connect", { link: this.link.value, bench: this.benches.value });
    } finally {
      say(this.connect, "Connect");
    }
  }

  async letGo() {
    await takeLease();
    await send("POST", "/api/board/disconnect");
    await giveLeaseBack();
  }

  async armAndStart() {
    const { identity } = this.state.now;
    const board = identity.serial ? `board ${identity.serial}` : "the board";
    await takeLease();
    const asked = { bench: this.benches.value, duration_s: Number(this.length.value), settings: this.settings.values() };
    const { drives, digest } = await send("POST", "/api/board/drives", asked); // the service says what would drive, whole
    const facts = drives.map((/** @type {{ name: string, value: string }} */ { name, value }) => [name, value]);
    if (!(await askConsent(board, [["bench file", asked.bench], ...facts]))) return false;
    await takeLease();
    await send("POST", "/api/board/start", { ...asked, consent: true, agreed: digest });
    return true;
  }

  /** @param {Record<string, number>} changed */
  async change(changed) {
    await takeLease();
    const answer = await send("PATCH", "/api/board/settings", changed);
    const later = Object.entries(answer?.at_next_start ?? {});
    if (later.length) notice(later.map(([name, why]) => `${name.replaceAll("_", " ")} at the next start: ${why}`).join("; "));
  }

  /** @param {Board} board @param {boolean} up */
  draw(board, up) {
    const mine = !board.lease || board.lease.holder === holder();
    this.connect.hidden = board.connected;
    this.disconnect.hidden = !board.connected;
    this.connect.disabled = !up || !mine;
    this.disconnect.disabled = !up || board.running || !mine;
    this.link.disabled = board.connected;
    if (board.connected && this.link.value !== board.link) this.link.value = board.link;
    // of a board that somebody else connected: the bench file that he named, until another is chosen here
    if (board.connected && !sessionStorage.getItem(CHOSEN) && this.benches.value !== board.bench && this.files.some((file) => file.name === board.bench)) {
      this.benches.value = board.bench;
      this.chosen(true);
    }
    this.start.disabled = !up || !board.connected || board.lost || board.running || !mine;
    this.stop.disabled = !up || !board.running;
    const lease = byId("lease");
    lease.hidden = mine;
    if (!mine && board.lease) say(lease, `Held by ${board.lease.holder}${board.lease.purpose ? ` (${board.lease.purpose})` : ""}. SAFE is for everybody.`);
    this.identity(board);
    this.progress(board);
  }

  /** @param {Board} board */
  identity({ connected, identity }) {
    const host = byId("identity");
    const rows = connected
      ? Object.entries({
          serial: identity.serial,
          firmware: versionOf(identity.firmware),
          "sample rate": identity.tick_rate_Hz && quantity(identity.tick_rate_Hz, "Hz", 4),
          sense: identity.sense_bits && `${identity.sense_bits} bit`,
          latency: identity.latency_ticks !== undefined && `${identity.latency_ticks} ${identity.latency_ticks === 1 ? "tick" : "ticks"}`,
        }).filter(([, value]) => value !== undefined && value !== null && value !== false)
      : [];
    host.hidden = rows.length === 0;
    const text = JSON.stringify(rows);
    if (host.dataset.shows === text) return;
    host.dataset.shows = text;
    fill(host, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, String(value))]));
  }

  /** @param {Board} board */
  progress(board) {
    byId("run-progress").hidden = !board.running;
    if (!board.running) return;
    const { stage, done, total } = board;
    const running = stage === "run" || stage === "";
    byId("run-bar", HTMLProgressElement).value = total ? Math.min(1, done / total) : 0;
    const t = board.run?.elapsed_s ?? (total ? (done / total) * (board.seconds ?? 0) : 0);
    say(byId("run-time"), running ? `${number(t, t < 10 ? 2 : 3)} s of ${duration(board.seconds)}` : `${stage} …`);
  }
}
