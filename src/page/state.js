// What the page knows. Views listen; nobody else keeps a copy.

/** @typedef {import("slipdrive-api").components["schemas"]} Schemas */
/** @typedef {Schemas["SolveRequest"]} SolveRequest */
/** @typedef {Schemas["Solution"]} Solution */
/** @typedef {Schemas["Trajectory"]} Trajectory */
/** @typedef {Schemas["Contacts"]} Contacts */
/** @typedef {Schemas["ContactModeSpan"]} Span */
/**
 * A request with its answer, as files keep it and `present` takes it, with the motion that the animation shows.
 * @typedef {{
 *   shown: Schemas["PresentedPlan"], body: import("./body.js").Body,
 *   spans: Span[], trajectory: Trajectory, contacts: Contacts | undefined,
 * }} Plan
 */
/**
 * @typedef {{
 *   request: SolveRequest,
 *   plan: Plan | null,
 *   compared: Plan | null,
 *   time: number,
 * }} State
 */

/** @type {State} */
const state = { request: {}, plan: null, compared: null, time: 0 };
/** @type {Map<keyof State, ((state: Readonly<State>) => void)[]>} */
const listeners = new Map();

/** @returns {Readonly<State>} */
export const current = () => state;

/**
 * Calls `listener` after each change of one of these.
 * @param {(keyof State)[]} keys
 * @param {(state: Readonly<State>) => void} listener
 */
export function listen(keys, listener) {
  for (const key of keys) listeners.set(key, [...(listeners.get(key) ?? []), listener]);
}

/** @param {Partial<State>} change */
export function change(change) {
  Object.assign(state, change);
  const called = new Set();
  for (const key of /** @type {(keyof State)[]} */ (Object.keys(change))) {
    for (const listener of listeners.get(key) ?? []) {
      if (!called.has(listener)) listener(state);
      called.add(listener);
    }
  }
}

/**
 * What is at a path of a request, such as `["maneuver", "goal", "x_m"]`.
 * @param {unknown} tree
 * @param {string[]} path
 * @returns {unknown}
 */
export function valueAt(tree, path) {
  return path.reduce((at, name) => (isRecord(at) && Object.hasOwn(at, name) ? at[name] : undefined), tree);
}

/**
 * The tree with another value at a path; undefined takes it away, and parents that are empty then.
 * @param {unknown} tree
 * @param {string[]} path
 * @param {unknown} value
 * @returns {Record<string, unknown>}
 */
export function withValue(tree, [name, ...rest], value) {
  const made = isRecord(tree) ? { ...tree } : {};
  const child = rest.length ? withValue(made[name], rest, value) : value;
  const isEmpty = child === undefined || (value === undefined && isRecord(child) && !Object.keys(child).length);
  if (isEmpty) delete made[name];
  else made[name] = child;
  return made;
}

/**
 * The same for requests that ask for the same, whatever the order of their fields and the view.
 * @param {SolveRequest} request
 */
export function written({ view: _, ...asked }) {
  return JSON.stringify(asked, (_, value) => (isRecord(value) ? Object.fromEntries(Object.entries(value).sort()) : value));
}

/**
 * @param {unknown} value
 * @returns {value is Record<string, unknown>}
 */
export function isRecord(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** Names of what is free at the goal. @param {SolveRequest} request @returns {string[]} */
export function freeOf(request) {
  const free = request.maneuver?.goal?.free;
  return Array.isArray(free) ? free : [];
}
