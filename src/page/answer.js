// The answer in words and numbers.

import { brief, byId, html, signed } from "./dom.js";
import { durationOf, forceAt, hasEnded, slipsAt, stepAt, torqueOf, valueOf } from "./motion.js";
import { labelOf } from "./schema.js";

/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("slipdrive-api").components["schemas"]["PlanInWords"]} PlanInWords */
/** @typedef {{ replay_tolerance_m: number, replay_tolerance_rad: number }} Tolerances */

/** By how much the replay may exceed a limit, as a share of it: the service's rule. */
const REPLAY_EXCESS = 0.005;

/**
 * What is known before the service has drawn: what the answer itself says.
 * @param {Plan} plan
 * @param {Tolerances} byDefault for those that the request leaves out
 */
export function showFacts({ shown, trajectory }, byDefault) {
  const { request, answer } = shown.solve ?? {};
  const end = trajectory.time_s.at(-1) ?? 0;
  const facts = answer
    ? factsOf(answer, { ...byDefault, ...request?.solver })
    : [["Final time", "final-time", `${end.toFixed(4)} s`]];
  byId("headline", HTMLElement).textContent = answer ? headline(answer) : "A simulated motion";
  byId("facts", HTMLElement).replaceChildren(
    ...facts.map(([name, id, value]) => html("div", {}, html("dt", {}, name), html("dd", { id }, value))),
  );
  const narrowed = answer && request ? narrowedBy(request, answer) : "";
  byId("narrow", HTMLElement).hidden = !narrowed;
  byId("narrowed", HTMLElement).textContent = narrowed;
  byId("words", HTMLElement).replaceChildren(...(answer?.reason ? [html("p", {}, answer.reason.message)] : []));
}

/** @param {string} status */
export const isMet = (status) => status === "converged" || status === "feasible";

/** @param {import("./state.js").Solution} answer */
function headline({ status, final_time_s, replay_confirmed }) {
  if (!isMet(status)) return "There is no plan that reaches the goal.";
  const doubt = replay_confirmed ? "" : ", which no replay in finer steps confirms";
  return `The robot reaches its goal in ${final_time_s.toFixed(3)} s${doubt}.`;
}

/**
 * @param {import("./state.js").Solution} answer
 * @param {Tolerances} tolerances
 * @returns {[string, string, string][]}
 */
function factsOf({ status, stop_reason, final_time_s, replay_confirmed, report }, tolerances) {
  const { lower_bound_s, solve_time_s } = report;
  const stopped = stop_reason === "finished" ? "" : `, ${stop_reason.replaceAll("_", " ")}`;
  /** @type {[string, string, string][]} */
  const ofMotion = final_time_s > 0 || isMet(status) ? [["Final time", "final-time", `${final_time_s.toFixed(4)} s`]] : [];
  /** @type {[string, string, string][]} */
  const ofPlan = [
    ["Replay", "replay", replay_confirmed ? "confirmed" : "not confirmed"],
    ["Replay miss", "replay-miss", missOf(report, tolerances)],
    ["No plan is faster than", "bound", lower_bound_s == null ? "not known" : `${lower_bound_s.toFixed(4)} s`],
  ];
  return [
    ...ofMotion,
    ["Status", "plan-status", `${status.replaceAll("_", " ")}${stopped}`],
    ...(isMet(status) ? ofPlan : []),
    ["Solved in", "solve-time", `${(1000 * solve_time_s).toFixed(0)} ms`],
  ];
}

/**
 * What the request asks less of than the service does by itself, where that may be why the plan is no better.
 * @param {import("./state.js").SolveRequest} request
 * @param {import("./state.js").Solution} answer
 */
function narrowedBy({ solver, grid }, { stop_reason, replay_confirmed }) {
  const words = [];
  if (stop_reason !== "finished") return "";
  if (solver?.starts === 1 && solver.method !== "nelder_mead") words.push("One start was asked for: more may find a faster plan.");
  if (grid?.steps && !replay_confirmed) words.push(`${grid.steps} steps were asked for: finer ones may be confirmed.`);
  return words.join(" ");
}

/**
 * How far from the goal the replay ends, and what else of it is beyond its bound.
 * @param {import("./state.js").Solution["report"]} report
 * @param {Tolerances} tolerances
 */
function missOf({ replay, limits }, { replay_tolerance_m: most_m, replay_tolerance_rad: most_rad }) {
  if (!replay) return "not known";
  // Speeds count by what they move in a second.
  const misses = /** @type {const} */ ([
    ["", replay.miss_m, most_m, 1000, "mm"],
    ["", replay.miss_heading_rad, most_rad, 1, "rad"],
    ["speed ", replay.miss_speed_m_s, most_m, 1000, "mm/s"],
    ["wheel speed ", replay.miss_wheel_speed_m_s, most_m, 1000, "mm/s"],
    ["yaw rate ", replay.miss_yaw_rate_rad_s, most_rad, 1, "rad/s"],
  ]).filter(([name, miss, most]) => !name || miss == null || miss > most);
  const exceeded = (limits ?? []).filter(({ replay_excess }) => (replay_excess ?? 0) > REPLAY_EXCESS);
  return [
    ...misses.map(([name, miss, , factor, unit]) => {
      return name + (miss == null ? "not known" : `${brief(factor * miss, 3)} ${unit}`);
    }),
    ...exceeded.map(exceededBy),
    ...(replay.separations ? ["a contact lifts"] : []),
  ].join(", ");
}

/** @param {import("slipdrive-api").components["schemas"]["LimitUse"]} used */
function exceededBy({ limit, largest, excess, replay_excess }) {
  const share = replay_excess ?? 0;
  if (limit !== "maneuver.keep_in") {
    return `${labelOf(limit.split(".")).toLowerCase()} ${brief(100 * share, 2)} % above its limit`;
  }
  // Both excesses are distances in one unit, of which `largest` tells the length in metres.
  const by = excess && largest ? ` by ${brief((1000 * largest * share) / excess, 3)} mm` : "";
  return `outside the aisle${by}`;
}

/** The service's sentences. @param {PlanInWords[]} plans @param {Plan} plan the first of them */
export function showWords(plans, { shown }) {
  const { status, final_time_s } = shown.solve?.answer ?? {};
  const claims = status === undefined || (isMet(status) && final_time_s !== 0);
  // Nothing speaks for an answer that does not belong to its request: so its numbers are not shown either.
  if (claims && !plans[0].certificate.length) byId("facts", HTMLElement).replaceChildren();
  byId("headline", HTMLElement).textContent = plans[0].headline;
  byId("words", HTMLElement).replaceChildren(...plans.flatMap(inWords));
}

/** @param {PlanInWords} words @param {number} index @param {PlanInWords[]} all */
function inWords({ label, headline, details, certificate }, index, all) {
  const title = all.length > 1 ? [html("h3", {}, `${label}. ${index ? headline : "This plan"}`)] : [];
  const why = certificate.map((sentence) => {
    const [topic, ...rest] = sentence.split(": ");
    return html("li", {}, ...(rest.length ? [html("b", {}, `${topic}: `), rest.join(": ")] : [sentence]));
  });
  const trust = why.length ? [html("h3", {}, "Why to trust it"), html("ul", {}, ...why)] : [];
  return [...title, ...details.map((sentence) => html("p", {}, sentence)), ...trust];
}

const SIDES = /** @type {const} */ (["left", "right"]);

/** The numbers of a moment. @param {HTMLElement} root @param {Plan | null} plan @param {number} time s */
export function showMoment(root, plan, time) {
  if (!plan || plan.trajectory.time_s.length < 2) return root.replaceChildren();
  const rows = hasEnded(plan, time) ? [["This plan", `ended at ${durationOf(plan).toFixed(3)} s`]] : momentOf(plan, time);
  // The same elements again: this runs at every frame.
  if (root.children.length !== rows.length) {
    root.replaceChildren(...rows.map(() => html("div", {}, html("dt"), html("dd"))));
  }
  rows.forEach(([name, value], index) => {
    const [term, said] = root.children[index].children;
    if (term.textContent !== name) term.textContent = name;
    said.textContent = value;
  });
}

/** @param {Plan} plan @param {number} time s */
function momentOf(plan, time) {
  const { trajectory } = plan;
  const speed = Math.hypot(valueOf(trajectory, "velocity_x_m_s", time), valueOf(trajectory, "velocity_y_m_s", time));
  const torque = torqueOf(plan, stepAt(trajectory, time));
  return [
    ["Speed", `${speed.toFixed(2)} m/s`],
    ["Yaw rate", `${signed(valueOf(trajectory, "yaw_rate_rad_s", time), 2)} rad/s`],
    ...SIDES.map((side) => {
      const { forward, right } = forceAt(plan, side, time);
      const mode = slipsAt(plan, side, time) ? "slips" : "sticks";
      return [
        `${side === "left" ? "Left" : "Right"} wheel`,
        `${mode}, torque ${signed(torque[side], 2)} N m, friction ${Math.hypot(forward, right).toFixed(1)} N`,
      ];
    }),
  ];
}
