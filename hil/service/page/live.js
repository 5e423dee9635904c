// The live connection: one WebSocket that is opened again whenever it is gone. A listener hears of the loss within
// a second, and a subscription stands until it is closed, over as many connections as that takes.

import { decode } from "./frame.js";
import { token } from "./session.js";

/** Silence for so long is a loss: the service says its state several times a second. */
const SILENCE_MS = 650;
const RETRY_MS = 400;

/** @typedef {import("./frame.js").Frame} Frame */
/** @typedef {{ up: boolean, refused?: string }} ServiceState */
/** @typedef {{ change: (request: Record<string, any>) => void, close: () => void }} Subscription */

export class Live extends EventTarget {
  constructor() {
    super();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.up = false;
    this.heard = 0;
    this.lastId = 0;
    /** @type {Map<number, { request: Record<string, any>, show: (frame: Frame) => void }>} */
    this.subscriptions = new Map();
    this.refused = "";
    setInterval(() => this.watch(), 100);
  }

  /** Open it, and keep it open. */
  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/api/live`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.heard = performance.now();
      this.say({ op: "hello", token: token() });
      for (const [id, { request }] of this.subscriptions) this.say({ ...request, id });
    };
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.socket = null;
      if (event.code === 4401 || event.code === 1008) this.refused = event.reason || "the service does not take this page's token";
      this.lost();
      setTimeout(() => this.open(), this.refused ? 2000 : RETRY_MS);
    };
  }

  /** @param {Record<string, any>} message @returns {boolean} whether there was somebody to say it to */
  say(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /**
   * Ask for frames, now and after each loss.
   *
   * @param {Record<string, any>} request with its op; the id is given here
   * @param {(frame: Frame) => void} show
   * @returns {Subscription}
   */
  subscribe(request, show) {
    const id = (this.lastId += 1);
    this.subscriptions.set(id, { request, show });
    this.say({ ...request, id });
    return {
      change: (changed) => {
        this.subscriptions.set(id, { request: changed, show });
        this.say({ ...changed, id });
      },
      close: () => {
        this.subscriptions.delete(id);
        this.say({ op: "unsubscribe", id });
      },
    };
  }

  /** @param {string | ArrayBuffer} data */
  receive(data) {
    this.heard = performance.now();
    if (typeof data !== "string") {
      const frame = decode(data);
      this.subscriptions.get(frame.id)?.show(frame);
      return;
    }
    const message = JSON.parse(data);
    if (!this.up && message.kind !== "error") {
      this.up = true;
      this.refused = "";
      this.tell("service", { up: true });
    }
    // of a run or a job: its row, which has a kind of its own
    this.tell(message.kind, message.kind === "run" || message.kind === "job" ? message[message.kind] : message);
  }

  watch() {
    const socket = this.socket;
    if (!socket || !this.up || performance.now() - this.heard < SILENCE_MS) return;
    this.socket = null; // a socket that hangs may take a minute to close: it is left to do so alone
    socket.onclose = socket.onmessage = null;
    socket.close();
    this.lost();
    this.open();
  }

  lost() {
    const known = !this.up;
    this.up = false;
    if (!known || this.refused) this.tell("service", { up: false, refused: this.refused });
  }

  /** @param {string} kind @param {any} detail */
  tell(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  /** @param {string} kind @param {(detail: any) => void} listener */
  on(kind, listener) {
    this.addEventListener(kind, (event) => listener(/** @type {CustomEvent} */ (event).detail));
  }
}
