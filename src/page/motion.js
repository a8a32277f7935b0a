// What a plan does at a time: between nodes poses are interpolated, and forces are those of the step.

/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("./state.js").Trajectory} Trajectory */
/** @typedef {import("./body.js").Pose} Pose */

/** @param {Plan | null} plan s */
export const durationOf = (plan) => plan?.trajectory.time_s.at(-1) ?? 0;

/** Whether a plan is over, as beside a longer one. @param {Plan} plan @param {number} time s */
export const hasEnded = (plan, time) => time > durationOf(plan);

/**
 * The step that a time is in, from 0.
 * @param {Trajectory} trajectory
 * @param {number} time
 */
export function stepAt({ time_s }, time) {
  let [low, high] = [0, Math.max(0, time_s.length - 2)];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time_s[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

/**
 * The value of a quantity of the trajectory at a time.
 * @param {Trajectory} trajectory
 * @param {Exclude<keyof Trajectory, "time_s">} name
 * @param {number} time
 */
export function valueOf(trajectory, name, time) {
  const [step, times, values] = [stepAt(trajectory, time), trajectory.time_s, trajectory[name]];
  const [from, to] = [values[step] ?? 0, values[step + 1] ?? values[step] ?? 0];
  const span = (times[step + 1] ?? times[step]) - times[step];
  const share = span > 0 ? Math.min(1, Math.max(0, (time - times[step]) / span)) : 0;
  return from + share * (to - from);
}

/**
 * @param {Trajectory} trajectory
 * @param {number} time
 * @returns {Pose}
 */
export function poseAt(trajectory, time) {
  return {
    x: valueOf(trajectory, "x_m", time),
    y: valueOf(trajectory, "y_m", time),
    heading: valueOf(trajectory, "heading_rad", time),
  };
}

/**
 * @param {Plan} plan
 * @param {"left" | "right" | "front"} contact
 * @param {number} time
 */
export function slipsAt(plan, contact, time) {
  if (hasEnded(plan, time)) return false;
  const span = plan.spans.find(({ end_s }) => time < end_s) ?? plan.spans.at(-1);
  return span?.[contact] === "slip";
}

/**
 * Friction on the robot at a contact, N.
 * @param {Plan} plan
 * @param {"left" | "right" | "front"} contact
 * @param {number} time
 */
export function forceAt(plan, contact, time) {
  const of = hasEnded(plan, time) ? undefined : plan.contacts?.[contact];
  const step = stepAt(plan.trajectory, time);
  return {
    forward: of?.longitudinal_force_n[step] ?? 0,
    right: of?.lateral_force_n[step] ?? 0,
    limit: of?.normal_force_n[step] ?? 0,
  };
}

/** @type {WeakMap<Plan, number>} */
const LARGEST = new WeakMap();

/** The largest friction force on a wheel, N, above 0. @param {Plan} plan */
export function largestForce(plan) {
  const known = LARGEST.get(plan);
  if (known) return known;
  const { left, right } = plan.contacts ?? {};
  const sizes = [left, right].flatMap((of) =>
    (of?.longitudinal_force_n ?? []).map((forward, step) => Math.hypot(forward ?? 0, of?.lateral_force_n[step] ?? 0)),
  );
  const largest = sizes.reduce((most, size) => Math.max(most, size), 1e-9);
  LARGEST.set(plan, largest);
  return largest;
}

/**
 * Torques of a step, N m: those of the interval that its middle is in, counted in whole numbers as the service does. In seconds a
 * middle on a boundary would be on either side of it by rounding.
 * @param {Plan} plan
 * @param {number} step from 0
 */
export function torqueOf({ shown, trajectory }, step) {
  const schedule = shown.solve ? shown.solve.answer.torque_schedule : shown.simulate?.request.torque_schedule;
  const [steps, intervals] = [trajectory.time_s.length - 1, schedule?.left_n_m.length ?? 0];
  if (!schedule || !intervals) return { left: 0, right: 0 };
  const interval = Math.floor(((2 * step + 1) * intervals) / (2 * steps));
  return { left: schedule.left_n_m[interval], right: schedule.right_n_m[interval] };
}

/**
 * A row per node: the state there, and torques, forces and slips of the step that begins there.
 * @param {Plan} plan
 */
export function asCsv(plan) {
  const torques = plan.trajectory.time_s.slice(0, -1).map((_, step) => torqueOf(plan, step));
  /** @type {[string, (number | null)[]][]} */
  const columns = [
    .../** @type {[string, number[]][]} */ (Object.entries(plan.trajectory)),
    ["torque_left_n_m", torques.map(({ left }) => left)],
    ["torque_right_n_m", torques.map(({ right }) => right)],
    ...Object.entries(plan.contacts ?? {}).flatMap(([contact, of]) =>
      Object.entries(of).map(([name, values]) => /** @type {[string, number[]]} */ ([`${contact}_${name}`, values])),
    ),
  ];
  const rows = plan.trajectory.time_s.map((_, node) => columns.map(([, values]) => values[node] ?? "").join(","));
  return `${[columns.map(([name]) => name).join(","), ...rows].join("\n")}\n`;
}
