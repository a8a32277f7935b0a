// Files of plans and requests: read, checked, and written.

import { html } from "./dom.js";
import { isRecord } from "./state.js";

/** @typedef {import("./state.js").Plan} Plan */

/**
 * @param {File} file
 * @returns {Promise<unknown>}
 */
export async function contentOf(file) {
  try {
    return JSON.parse(await file.text());
  } catch {
    throw new Error(`${file.name} is not JSON`);
  }
}

/**
 * The plan of a file, as the command line and this page save it; null where it holds a request alone.
 * @param {unknown} content
 * @returns {Plan["shown"] | null}
 */
export function savedPlan(content) {
  const of = isRecord(content) && Array.isArray(content.plans) ? content.plans[0] : content;
  for (const kind of ["solve", "simulate"]) {
    const pair = isRecord(of) ? of[kind] : undefined;
    if (pair == null) continue;
    if (!isRecord(pair) || !isRecord(pair.request) || !isRecord(pair.answer)) {
      throw new Error("its plan is without a request or an answer");
    }
    return /** @type {Plan["shown"]} */ ({ [kind]: pair });
  }
  return null;
}

/**
 * A request to solve, of a file or a link.
 * @param {unknown} content
 * @param {string[]} names what it may hold
 */
export function savedRequest(content, names) {
  if (!isRecord(content)) throw new Error("it holds neither a request nor a plan");
  const other = Object.keys(content).find((name) => !names.includes(name));
  if (other !== undefined) throw new Error(`it holds “${other}”, which no request to solve has`);
  const solver = isRecord(content.solver) ? content.solver : {};
  // JSON of browsers would change it without a word.
  if (typeof solver.seed === "number" && !Number.isSafeInteger(solver.seed)) {
    throw new Error("solver.seed is beyond 2^53, which a browser cannot hold: use the command line");
  }
  return /** @type {import("./state.js").SolveRequest} */ (content);
}

/**
 * @param {string} name
 * @param {string} type
 * @param {BlobPart} content
 */
export function download(name, type, content) {
  const url = URL.createObjectURL(new Blob([content], { type }));
  html("a", { href: url, download: name }).click();
  // Firefox reads it after the click.
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
