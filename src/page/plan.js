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
  const motion = await motionOf(shown, simulate);
  if (!isMotion(motion.trajectory)) throw new Error("the plan has no motion");
  return {
    shown,
    body: bodyOf(request, referenceRobot),
    trajectory: motion.trajectory,
    contacts: motion.contacts,
    spans: Array.isArray(answer.contact_modes) ? answer.contact_modes : (motion.contact_modes ?? []),
  };
}

/** @param {Plan["shown"]} shown @param {(body: unknown) => Promise<any>} simulate @returns {Promise<any>} */
async function motionOf({ solve, simulate: simulated }, simulate) {
  const { request, answer } = /** @type {{ request: any, answer: any }} */ (solve ?? simulated);
  if (isMotion(answer.trajectory) && answer.contacts) return answer;
  if (!solve) return simulate(request);
  return answer.torque_schedule?.left_n_m?.length ? simulate(simulation(request, answer)) : standing(answer);
}

/** @param {unknown} value @returns {value is Trajectory} */
function isMotion(value) {
  if (!isRecord(value) || !Array.isArray(value.time_s) || !value.time_s.length) return false;
  const { time_s } = value;
  return ["x_m", "y_m", "heading_rad"].every((name) => {
    const values = value[name];
    return Array.isArray(values) && values.length === time_s.length;
  });
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
