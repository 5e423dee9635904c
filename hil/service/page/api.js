// Requests to the service. Every error is one line, and a remedy where there is one.

import { token } from "./session.js";

/** What the service refused, in its own words. */
export class Refusal extends Error {
  /**
   * @param {string} message one line
   * @param {string} [remedy]
   * @param {number} [status] of HTTP; 0 where nobody answered
   * @param {any} [details] all that the service said
   */
  constructor(message, remedy = "", status = 0, details = null) {
    super(message);
    this.remedy = remedy;
    this.status = status;
    this.details = details;
  }
}

/** @type {string | null} */
let lease = null;

/** @param {string | null} value of the header X-Lease from now on */
export function useLease(value) {
  lease = value;
}

/** @returns {string | null} */
export function currentLease() {
  return lease;
}

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} [body] sent as JSON, a FormData as it is
 * @param {{ signal?: AbortSignal, keepalive?: boolean }} [how]
 * @returns {Promise<Response>} of a request that succeeded
 */
async function request(method, path, body, { signal, keepalive } = {}) {
  /** @type {Record<string, string>} */
  const headers = { Authorization: `Bearer ${token()}` };
  if (lease) headers["X-Lease"] = lease;
  /** @type {BodyInit | undefined} */
  let sent;
  if (body instanceof FormData) sent = body;
  else if (body !== undefined) {
    headers["Content-Type"] = "application/json";
    sent = JSON.stringify(body);
  }
  let answer;
  try {
    answer = await fetch(path, { method, headers, body: sent, signal, keepalive, cache: "no-store", credentials: "omit" });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new Refusal("the service does not answer", "is `hil serve` still running?");
  }
  if (answer.ok) return answer;
  const said = await answer.json().catch(() => null);
  const message = said?.error ?? `${method} ${path}: ${answer.status} ${answer.statusText}`;
  throw new Refusal(message, said?.remedy ?? "", answer.status, said);
}

/** @param {string} path @param {AbortSignal} [signal] @returns {Promise<any>} */
export const get = async (path, signal) => (await request("GET", path, undefined, { signal })).json();

/** @param {string} path @param {AbortSignal} [signal] @returns {Promise<ArrayBuffer>} */
export async function getBytes(path, signal) {
  for (;;) {
    const answer = await request("GET", path, undefined, { signal });
    if (answer.status !== 202) return answer.arrayBuffer();
    await new Promise((resolve) => setTimeout(resolve, 1000)); // a long record is being prepared, which the jobs tell
  }
}

/** @param {string} method @param {string} path @param {unknown} [body] @param {{ keepalive?: boolean }} [how] @returns {Promise<any>} */
export async function send(method, path, body, how) {
  const answer = await request(method, path, body, how);
  const text = await answer.text();
  return text ? JSON.parse(text) : null;
}

/** @param {Record<string, string | number | null | undefined>} values @returns {string} "?a=1&b=2", or "" */
export function query(values) {
  const there = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const text = new URLSearchParams(there.map(([name, value]) => [name, String(value)])).toString();
  return text && `?${text}`;
}
