// The robot seen from above: its outline, wheels and reference point, from the axle midpoint, right and forward in metres.

import { isRecord, valueAt } from "./state.js";

/** @typedef {{ x: number, y: number, heading: number }} Pose */
/** @typedef {[number, number]} Point */

/**
 * @typedef {{
 *   outline: Point[], wheels: { left: Point, right: Point }, front: Point,
 *   radius: number, tread: number, reference: Point,
 * }} Body
 */

/**
 * @param {unknown} request
 * @param {Record<string, number>} byDefault the reference robot, for fields that the request leaves out
 * @returns {Body}
 */
export function bodyOf(request, byDefault) {
  /** @param {string} name */
  const of = (name) => numberOr(valueAt(request, ["robot", name]), byDefault[name] ?? 0);
  const [half, radius, front, right] = [
    of("track_width_m") / 2,
    of("wheel_radius_m"),
    of("axle_to_front_support_m"),
    of("front_support_right_m"),
  ];
  const point = valueAt(request, ["maneuver", "reference_point"]) ?? valueAt(request, ["reference_point"]);
  /** @type {Point} */
  const reference = point === "axle_midpoint" ? [0, 0] : [of("center_of_mass_right_m"), of("center_of_mass_forward_m")];
  return {
    outline: outlineOf(valueAt(request, ["robot", "footprint"])) ?? wedge(half, radius, front, right),
    wheels: { left: [-half, 0], right: [half, 0] },
    front: [right, front],
    radius,
    tread: Math.min(0.5 * radius, 0.3 * half),
    reference,
  };
}

/**
 * Around wheels and front support, where no footprint is given; the figures show the same.
 * @param {number} half @param {number} radius @param {number} front @param {number} right
 * @returns {Point[]}
 */
function wedge(half, radius, front, right) {
  const nose = 0.24 * half;
  return [
    [-half, -radius],
    [half, -radius],
    [half, 0.7 * radius],
    [right + nose, front],
    [right - nose, front],
    [-half, 0.7 * radius],
  ];
}

/** @param {unknown} corners @returns {Point[] | undefined} */
function outlineOf(corners) {
  if (!Array.isArray(corners) || corners.length < 3) return undefined;
  return corners.map((corner) => [
    numberOr(isRecord(corner) ? corner.right_m : 0, 0),
    numberOr(isRecord(corner) ? corner.forward_m : 0, 0),
  ]);
}

/** The farthest that a robot reaches from its reference point, m. @param {Body} body */
export const reachOf = ({ outline, reference: [right, forward] }) =>
  Math.max(0.3, ...outline.map(([r, f]) => Math.hypot(r - right, f - forward)));

/**
 * A pose of a start or goal; what is absent is taken from another.
 * @param {unknown} state
 * @param {Pose} byDefault
 * @returns {Pose}
 */
export function poseOf(state, byDefault) {
  return {
    x: numberOr(valueAt(state, ["x_m"]), byDefault.x),
    y: numberOr(valueAt(state, ["y_m"]), byDefault.y),
    heading: numberOr(valueAt(state, ["heading_rad"]), byDefault.heading),
  };
}

/**
 * From the robot to the world, where the reference point has this pose. Heading 0 faces y, positive turns left.
 * @param {Body} body @param {Pose} pose @returns {(point: Point) => Point}
 */
export function placing({ reference: [right, forward] }, { x, y, heading }) {
  const [sin, cos] = [Math.sin(heading), Math.cos(heading)];
  return ([r, f]) => [x + (r - right) * cos - (f - forward) * sin, y + (r - right) * sin + (f - forward) * cos];
}

/** A number that can be drawn: the service refuses larger ones. @param {unknown} value @param {number} byDefault */
export function numberOr(value, byDefault) {
  if (typeof value !== "number" || !Number.isFinite(value)) return byDefault;
  return Math.max(-MOST, Math.min(MOST, value));
}

const MOST = 1e5;
