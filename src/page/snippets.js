// A request as something to send on: a link, a command, a program.

import { isRecord } from "./state.js";

const MARK = "#request=";

/** @param {unknown} request */
export function linkTo(request) {
  return `${location.origin}${location.pathname}${MARK}${encodeURIComponent(JSON.stringify(request))}`;
}

/**
 * The request of a link's fragment; undefined where there is none.
 * @param {string} fragment
 * @returns {unknown}
 */
export function requestIn(fragment) {
  if (!fragment.startsWith(MARK)) return undefined;
  return JSON.parse(decodeURIComponent(fragment.slice(MARK.length)));
}

/** @param {unknown} request as the service completed it */
export function asCurl(request) {
  return [
    `curl -s ${quoted(`${location.origin}/solve`)}`,
    `-H "Authorization: Bearer $SLIPDRIVE_API_KEY"`,
    "-H 'Content-Type: application/json'",
    `-d ${quoted(JSON.stringify(request))}`,
  ].join(" \\\n  ");
}

/** @param {unknown} request as the service completed it */
export function asPython(request) {
  return `import os

import slipdrive

client = slipdrive.Client(${literal(location.origin, "")}, os.environ.get("SLIPDRIVE_API_KEY"))
plan = client.solve(${literal(request, "")})
print(plan.status, plan.final_time_s)
`;
}

/** A word of a POSIX shell. @param {string} text */
const quoted = (text) => `'${text.replaceAll("'", "'\\''")}'`;

/**
 * A value as Python writes it. Its strings are those of JSON, escapes and all.
 * @param {unknown} value
 * @param {string} indent
 * @returns {string}
 */
function literal(value, indent) {
  if (value === null || value === undefined) return "None";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (Array.isArray(value)) return `[${value.map((each) => literal(each, indent)).join(", ")}]`;
  if (!isRecord(value)) return JSON.stringify(value);
  const inner = `${indent}    `;
  const lines = Object.entries(value).map(([name, each]) => `${inner}${JSON.stringify(name)}: ${literal(each, inner)},\n`);
  return `{\n${lines.join("")}${indent}}`;
}
