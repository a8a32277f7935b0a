// All that goes over the network. The key stays in this module's memory.

import { isRecord } from "./state.js";

/** @typedef {import("slipdrive-api").components["schemas"]["Problem"]} Problem */

let key = "";

/** @param {string} text */
export function useKey(text) {
  key = text.trim();
}

/** What the service refused, or what came in between. */
export class Refusal extends Error {
  /**
   * @param {string} message for people
   * @param {Problem} [problem] what the service said
   */
  constructor(message, problem) {
    super(message);
    this.problem = problem;
  }
}

/**
 * JSON from the service, or a `Refusal`.
 * @param {string} path
 * @param {unknown} [body] with it, a POST
 * @param {AbortSignal} [signal]
 * @returns {Promise<any>}
 */
export async function ask(path, body, signal) {
  const response = await send(path, body, "application/json", signal);
  try {
    return await response.json();
  } catch (error) {
    throw lost(error);
  }
}

/**
 * Solves, and tells of events on the way.
 * @param {unknown} request
 * @param {(name: string, data: any) => void} onEvent
 * @param {AbortSignal} signal whose abort ends the job on its worker too
 * @returns {Promise<any>}
 */
export async function solve(request, onEvent, signal) {
  const response = await send("solve", request, "text/event-stream", signal);
  try {
    for await (const { name, data } of events(response)) {
      if (name === "result") return data;
      if (name === "problem") throw refused(data, null);
      onEvent(name, data);
    }
  } catch (error) {
    throw lost(error);
  }
  throw lost(null);
}

/**
 * @param {string} path
 * @param {unknown} body
 * @param {string} accept
 * @param {AbortSignal | undefined} signal
 */
async function send(path, body, accept, signal) {
  /** @type {Record<string, string>} */
  const headers = { accept };
  if (!/^[\x20-\x7e]*$/.test(key)) {
    throw new Refusal("The API key has a letter or sign beyond ASCII, which cannot be sent: enter it again.");
  }
  if (key) headers.authorization = `Bearer ${key}`;
  if (body !== undefined) headers["content-type"] = "application/json";
  const method = body === undefined ? "GET" : "POST";
  let response;
  try {
    response = await fetch(path, { method, headers, signal, body: JSON.stringify(body) });
  } catch (error) {
    throw lost(error);
  }
  if (response.ok) return response;
  throw refused(await response.json().catch(() => null), response);
}

/** @param {unknown} error */
function lost(error) {
  if (error instanceof Refusal || (error instanceof DOMException && error.name === "AbortError")) return error;
  return new Refusal(
    "The connection to the service was lost before the answer came. The service keeps nothing of it: try again.",
  );
}

/**
 * @param {any} problem
 * @param {Response | null} response
 */
function refused(problem, response) {
  if (!isRecord(problem) || typeof problem.detail !== "string") {
    return new Refusal(`The service answered with status ${response?.status} and no words.`);
  }
  const said = /** @type {Problem} */ (problem);
  const wait = said.retry_after_ms ?? 1000 * Number(response?.headers.get("retry-after") ?? 0);
  const again = said.retryable && wait > 0 ? ` Try again in ${Math.max(1, Math.round(wait / 1000))} s.` : "";
  // Faults of fields are listed one by one, and the wait is said once.
  const detail = said.errors?.length ? "" : ` It says: ${said.detail.replace(/, try again in \d+ s$/, "")}.`;
  return new Refusal(`${WORDS[said.code] ?? "The service refuses."}${detail}${again}`, said);
}

/** @type {Record<string, string>} What the codes mean to who sits before the page. */
const WORDS = {
  unauthenticated: "The service asks for an API key: enter yours above.",
  invalid_value: "Some values break their rules.",
  invalid_field: "The request is not as the service expects it.",
  problem_too_large: "The maneuver is larger than this service accepts.",
  body_too_large: "The request is larger than this service accepts.",
  queue_full: "The service is busy: others wait already.",
  memory_full: "The service is busy: its memory is full.",
  deadline_unreachable: "The service is busy: the wait would be too long.",
  unavailable: "The service takes no work at present.",
  time_limit_exceeded: "The time limit passed before there was a plan: allow more time or ask for fewer steps.",
};

/**
 * Server-sent events of a response.
 * @param {Response} response
 */
async function* events(response) {
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const blocks = (rest + value).split("\n\n");
    rest = blocks.pop() ?? "";
    for (const block of blocks) {
      const fields = new Map(block.split("\n").map((line) => /** @type {const} */ ([before(line), after(line)])));
      const data = fields.get("data");
      if (data !== undefined) yield { name: fields.get("event") ?? "message", data: JSON.parse(data) };
    }
  }
}

/** @param {string} line */
const before = (line) => line.slice(0, Math.max(0, line.indexOf(":")));
/** @param {string} line */
const after = (line) => line.slice(line.indexOf(":") + 1).trimStart();
