// The floor from above: start, goal, aisle, and the motion of plans.

import { bodyOf, numberOr, placing, poseOf, reachOf } from "./body.js";
import { setAttributes, signed, svg } from "./dom.js";
import { Handle } from "./handle.js";
import { Robot } from "./robot.js";
import { poseAt } from "./motion.js";
import { freeOf, isRecord, valueAt } from "./state.js";
import { roundStep, View } from "./view.js";

/** @typedef {import("./state.js").State} State */
/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("./body.js").Point} Point */
/** @typedef {import("./body.js").Pose} Pose */

/** Room around all that is shown, px; the lines of the grid are at least so far apart. */
const MARGIN_PX = 56;
const GRID_PX = 56;
const CLEAR_PX = 46;
/** A robot that is followed reaches over so much of the frame. */
const FOLLOWED_SHARE = 0.2;
/** Nodes of a trace nearer than this are within a pixel at every scale, m. */
const SEEN_M = 0.002;

export class Floor {
  #view = new View(80, false, [200, 200]);
  #frame = { width: 0, height: 0 };
  #grid = svg("g", { class: "grid", "aria-hidden": "true" });
  #aisle = svg("polygon", { class: "keep-in", "aria-hidden": "true" });
  #traces = svg("g", { "aria-hidden": "true" });
  /** @type {Robot[]} */
  #robots;
  /** @type {Handle[]} */
  #handles;
  /** @type {Readonly<State> | null} */
  #state = null;
  isFollowing = false;

  /**
   * @param {SVGSVGElement} root
   * @param {Record<string, number>} byDefault the reference robot
   * @param {(which: "start" | "goal", moved: Partial<Pose>) => void} onMove
   */
  constructor(root, byDefault, onMove) {
    this.root = root;
    this.byDefault = byDefault;
    const view = () => this.#view;
    this.#handles = /** @type {const} */ (["start", "goal"]).map(
      (which) =>
        new Handle(
          which,
          view,
          (moved) => onMove(which, moved),
          () => this.refit(),
        ),
    );
    this.#robots = [new Robot("b"), new Robot("a")];
    const [handles, robots] = [this.#handles, this.#robots].map((all) => all.map(({ element }) => element));
    const names = this.#handles.map(({ name }) => name);
    root.append(this.#grid, this.#aisle, this.#traces, ...handles, ...names, ...robots);
    new ResizeObserver(() => this.#resize()).observe(root);
  }

  #resize() {
    const { width, height } = this.root.getBoundingClientRect();
    if (!width || (width === this.#frame.width && height === this.#frame.height)) return;
    this.#frame = { width, height };
    setAttributes(this.root, { viewBox: `0 0 ${width} ${height}` });
    if (this.#state) this.show(this.#state);
  }

  /** All of it: after a change of the request or of the plans. @param {Readonly<State>} state */
  show(state) {
    this.#state = state;
    const reach = reachOf(bodyOf(state.request, this.byDefault));
    if (!this.#isHeld()) {
      this.#fit(endsOf(state).flatMap((pose) => around(pose, reach)));
      this.#traces.replaceChildren(...tracesOf(state.compared, "b"), ...tracesOf(state.plan, "a"));
    }
    this.#showHandles(state);
    this.showTime(state);
  }

  /** The moment alone. @param {Readonly<State>} state */
  showTime(state) {
    const plans = [state.compared, state.plan];
    if (this.isFollowing && !this.#isHeld()) this.#follow(state);
    this.#robots.forEach((robot, index) => robot.show(plans[index], state.time, this.#view));
  }

  /** Shows everything again, after following ended or a handle was let go. */
  refit() {
    if (this.#state) this.show(this.#state);
  }

  #isHeld() {
    return this.#handles.some(({ isHeld }) => isHeld);
  }

  /** @param {Point[]} points */
  #fit(points) {
    const state = this.#state;
    const paths = [state?.plan, state?.compared].flatMap((plan) => (plan ? everyPoint(plan) : []));
    this.#view = View.fitting([...points, ...paths, ...this.#corners()], this.#frame, MARGIN_PX);
    this.#drawGround();
  }

  /** @param {Readonly<State>} state */
  #follow({ plan, time }) {
    if (!plan) return;
    const { x, y } = poseAt(plan.trajectory, time);
    const scale = (FOLLOWED_SHARE * Math.min(this.#frame.width, this.#frame.height)) / reachOf(plan.body);
    this.#view = new View(scale, this.#view.onSide, [0, 0]).centred([x, y], this.#frame);
    this.#drawGround();
    if (this.#state) this.#showHandles(this.#state);
  }

  /** @param {Readonly<State>} state */
  #showHandles(state) {
    const [body, poses] = [bodyOf(state.request, this.byDefault), endsOf(state)];
    const free = freeOf(state.request);
    this.#handles.forEach((handle, index) => handle.show(body, poses[index], index ? free : []));
  }

  /** @returns {Point[]} */
  #corners() {
    const corners = valueAt(this.#state?.request, ["maneuver", "keep_in"]);
    if (!Array.isArray(corners)) return [];
    return corners.filter(isRecord).map(({ x_m, y_m }) => [numberOr(x_m, 0), numberOr(y_m, 0)]);
  }

  #drawGround() {
    this.#grid.replaceChildren(...gridLines(this.#view, this.#frame));
    const corners = this.#corners().map((corner) => this.#view.place(corner));
    setAttributes(this.#aisle, { points: corners.map((corner) => corner.join(",")).join(" ") });
    // They stay in metres: a view that follows moves at every frame.
    setAttributes(this.#traces, { transform: this.#view.matrix() });
  }
}

/**
 * The path of the reference point, and the tracks of wheels, with where they slip.
 * @param {Plan | null} plan
 * @param {string} name
 */
function tracesOf(plan, name) {
  if (!plan) return [];
  const [body, poses] = [plan.body, everyPose(plan)];
  const path = svg("path", { class: `trace plan-${name}`, d: pathOf(poses.map(({ x, y }) => [x, y])) });
  const tracks = /** @type {const} */ (["left", "right"]).flatMap((wheel) => {
    const points = poses.map((pose) => placing(body, pose)(body.wheels[wheel]));
    const track = svg("path", { class: "track", d: pathOf(points) });
    const slips = plan.spans
      .filter((span) => span[wheel] === "slip")
      .map(({ start_s, end_s }) => {
        const within = points.filter((_, node) => inside(plan.trajectory.time_s[node], start_s, end_s));
        return svg("path", { class: "slip", d: pathOf(within) });
      });
    return [track, ...slips];
  });
  return [...tracks, path];
}

/** Start and goal. @param {Readonly<State>} state */
function endsOf({ request }) {
  const start = poseOf(request.maneuver?.start, { x: 0, y: 0, heading: 0 });
  return [start, poseOf(request.maneuver?.goal, start)];
}

/** @param {number} time @param {number} start @param {number} end */
const inside = (time, start, end) => time >= start - 1e-9 && time <= end + 1e-9;

/** @param {Plan} plan @returns {Pose[]} */
const everyPose = ({ trajectory: { x_m, y_m, heading_rad } }) =>
  x_m.map((x, node) => ({ x: x ?? NaN, y: y_m[node] ?? NaN, heading: heading_rad[node] ?? NaN }));

/** Room for the robot of a plan all the way. @param {Plan} plan */
function everyPoint(plan) {
  const reach = reachOf(plan.body);
  return everyPose(plan).flatMap((pose) => around(pose, reach));
}

/** Room for a robot at a pose. @param {Pose} pose @param {number} reach m @returns {Point[]} */
const around = ({ x, y }, reach) => [
  [x - reach, y - reach],
  [x + reach, y + reach],
];

/** @param {Point[]} points m */
function pathOf(points) {
  const finite = points.filter(([x, y]) => Number.isFinite(x + y));
  let [lastX, lastY] = [NaN, NaN];
  const seen = finite.filter(([x, y], index) => {
    if (index < finite.length - 1 && Math.hypot(x - lastX, y - lastY) < SEEN_M) return false;
    [lastX, lastY] = [x, y];
    return true;
  });
  return seen.map(([x, y], index) => `${index ? "L" : "M"}${x.toFixed(4)} ${y.toFixed(4)}`).join("");
}

/** @param {View} view @param {{ width: number, height: number }} frame */
function gridLines(view, { width, height }) {
  const step = roundStep(GRID_PX / view.scale);
  const [a, b] = [view.unplace([0, height]), view.unplace([width, 0])];
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  return [0, 1]
    .flatMap((axis) => {
      const [low, high] = [Math.min(a[axis], b[axis]), Math.max(a[axis], b[axis])];
      const count = Math.min(100, Math.floor(high / step) - Math.ceil(low / step) + 1);
      const lines = Array.from({ length: Math.max(0, count) }, (_, index) => {
        const value = (Math.ceil(low / step) + index) * step;
        const [px, py] = view.place(axis === 0 ? [value, 0] : [0, value]);
        const isUpright = (axis === 0) !== view.onSide;
        const line = isUpright ? { x1: px, x2: px, y1: 0, y2: height } : { x1: 0, x2: width, y1: py, y2: py };
        const text = isUpright ? { x: px + 3, y: height - 5 } : { x: 4, y: py - 3 };
        // Labels of the other axis and the edges of the frame stay free.
        const isClear = isUpright ? px > CLEAR_PX && px < width - CLEAR_PX : py > CLEAR_PX / 2 && py < height - CLEAR_PX / 2;
        return { value, line, text: isClear ? text : undefined };
      });
      // The axis is named at 0, or where it is nearest to 0.
      const named = Math.min(...lines.filter(({ text }) => text).map(({ value }) => Math.abs(value)));
      return lines.map(({ value, line, text }) => {
        const name = Math.abs(value) === named ? (axis === 0 ? "x " : "y ") : "";
        const words = name && value === 0 ? `${name}= 0` : `${name}${signed(value, digits)} m`;
        return svg("g", {}, svg("line", line), ...(text ? [svg("text", text, words)] : []));
      });
    })
    .flat();
}
