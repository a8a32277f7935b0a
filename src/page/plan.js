// Makes a plan that can be shown from an answer of the service.

import { bodyOf } from "./body.js";
import { isRecord } from "./state.js";

/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("./state.js").Trajectory} Trajectory */
/** @typedef {import("./state.js").Contacts} Contacts */

/**
 * A plan with its motion. Where the answer came without one, as the view `plan` does, the service integrates it again.
 * @param {Plan["shown"]} shown
 * @param {(body: unknown) => Promise<any>} simulate
 * @param {Record<string, number>} referenceRobot for fields that the request leaves out
 * @returns {Promise<Plan>}
 */
export async function planOf(shown, simulate, referenceRobot) {
  const { request, answer } = /** @type {{ request: any, answer: any }} */ (shown.solve ?? shown.simulate);
  if (!(shown.solve ? isAnswer(answer) : areTorques(request.torque_schedule))) throw new Error("its plan is damaged");
  const motion = await motionOf(shown, simulate);
  if (!isMotion(motion.trajectory)) throw new Error("the plan has no motion");
  return {
    shown,
    body: bodyOf(request, referenceRobot),
    trajectory: motion.trajectory,
    contacts: motion.contacts,
    spans: [answer.contact_modes, motion.contact_modes].find(areSpans) ?? [],
  };
}

/** @param {Plan["shown"]} shown @param {(body: unknown) => Promise<any>} simulate @returns {Promise<any>} */
async function motionOf({ solve, simulate: simulated }, simulate) {
  const { request, answer } = /** @type {{ request: any, answer: any }} */ (solve ?? simulated);
  if (isMotion(answer.trajectory) && areContacts(answer.contacts) && areSpans(answer.contact_modes)) return answer;
  if (!solve) return simulate(request);
  return answer.torque_schedule.left_n_m.length ? simulate(simulation(request, answer)) : standing(answer);
}

/** Whether an answer has what the page reads of it, beside its motion. @param {any} answer */
const isAnswer = ({ status, stop_reason, final_time_s, report, torque_schedule }) =>
  [status, stop_reason].every((word) => typeof word === "string") &&
  [final_time_s, report?.solve_time_s, report?.lower_bound_s ?? 0].every(Number.isFinite) &&
  Array.isArray(report.limits ?? []) &&
  areTorques(torque_schedule);

/** @param {any} schedule */
const areTorques = (schedule) =>
  areNumbers(schedule?.left_n_m) && areNumbers(schedule.right_n_m) && schedule.left_n_m.length === schedule.right_n_m.length;

/** @param {unknown} values */
const areNumbers = (values) => Array.isArray(values) && values.every(Number.isFinite);

/** @param {unknown} spans */
const areSpans = (spans) =>
  Array.isArray(spans) &&
  spans.every((span) => areNumbers([span?.start_s, span?.end_s])) &&
  spans.every(({ left, right, front }) => [left, right, front].every((mode) => typeof mode === "string"));

/** @param {any} contacts */
const areContacts = (contacts) =>
  ["left", "right"].every((side) =>
    ["longitudinal_force_n", "lateral_force_n", "normal_force_n"].every((name) => Array.isArray(contacts?.[side]?.[name])),
  );

const POSE = ["x_m", "y_m", "heading_rad"];
const RATES = ["velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s"];

/** @param {unknown} value @returns {value is Trajectory} */
function isMotion(value) {
  if (!isRecord(value) || !Array.isArray(value.time_s) || !areNumbers(value.time_s)) return false;
  const { length } = value.time_s;
  const names = length > 1 ? [...POSE, ...RATES] : POSE;
  return length > 0 && names.every((name) => Array.isArray(value[name]) && value[name].length === length);
}

/** The motion of an answer without torques. @param {any} answer */
function standing({ end_state }) {
  const { x_m, y_m, heading_rad } = end_state ?? {};
  return { trajectory: { time_s: [0], x_m: [x_m], y_m: [y_m], heading_rad: [heading_rad] } };
}

/** The request that integrates the torques of an answer. @param {any} request @param {any} answer */
function simulation({ robot, payload, maneuver }, answer) {
  return {
    robot,
    payload,
    reference_point: maneuver?.reference_point,
    start: maneuver?.start,
    torque_schedule: answer.torque_schedule,
    grid: { steps: answer.report?.steps },
  };
}

/** What `present` needs of a plan: the motion is rolled out again there. @param {Plan} plan @returns {Plan["shown"]} */
export function stripped({ shown }) {
  /** @param {any} pair */
  const bare = ({ request, answer: { trajectory, contacts, ...answer } }) => ({ request, answer });
  return shown.solve ? { solve: bare(shown.solve) } : { simulate: bare(shown.simulate) };
}
