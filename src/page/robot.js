// A robot on the floor at a moment: its body, wheels that stick or slip, and the friction forces on them.

import { placing } from "./body.js";
import { setAttributes, svg } from "./dom.js";
import { forceAt, largestForce, poseAt, slipsAt } from "./motion.js";

/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("./body.js").Point} Point */
/** @typedef {import("./view.js").View} View */

/** Length of the longest arrow, px. */
const ARROW_PX = 70;
const SIDES = /** @type {const} */ (["left", "right"]);

export class Robot {
  #outline = svg("polygon", { class: "body" });
  #nose = svg("polyline", { class: "nose" });
  #wheels = { left: svg("polygon"), right: svg("polygon") };
  #forces = { left: svg("path", { class: "force" }), right: svg("path", { class: "force" }) };

  /** @param {string} name of the plan: a or b */
  constructor(name) {
    const parts = [
      this.#outline,
      this.#nose,
      ...SIDES.map((side) => this.#wheels[side]),
      ...SIDES.map((side) => this.#forces[side]),
    ];
    this.element = svg("g", { class: `robot plan-${name}`, "aria-hidden": "true" }, ...parts);
  }

  /** @param {Plan | null} plan @param {number} time s @param {View} view */
  show(plan, time, view) {
    setAttributes(this.element, { visibility: plan ? undefined : "hidden" });
    if (!plan) return;
    const { body } = plan;
    const place = placing(body, poseAt(plan.trajectory, time));
    /** @param {Point[]} corners */
    const polygon = (corners) => ({ points: corners.map((corner) => view.place(place(corner)).join(",")).join(" ") });
    setAttributes(this.#outline, polygon(body.outline));
    const [half, ahead] = [body.wheels.right[0], 0.5 * body.front[1]];
    setAttributes(
      this.#nose,
      polygon([
        [-0.25 * half, ahead - 0.35 * half],
        [0, ahead],
        [0.25 * half, ahead - 0.35 * half],
      ]),
    );
    for (const side of SIDES) {
      const [[right, forward], { radius, tread }] = [body.wheels[side], body];
      const corners = [
        [-1, -1],
        [1, -1],
        [1, 1],
        [-1, 1],
      ].map(([r, f]) => /** @type {Point} */ ([right + r * tread, forward + f * radius]));
      const state = slipsAt(plan, side, time) ? "slips" : "sticks";
      setAttributes(this.#wheels[side], { ...polygon(corners), class: `wheel ${state}` });
      const force = forceAt(plan, side, time);
      const perNewton = ARROW_PX / largestForce(plan) / view.scale;
      const from = view.place(place([right, forward]));
      const to = view.place(place([right + force.right * perNewton, forward + force.forward * perNewton]));
      setAttributes(this.#forces[side], { d: arrow(from, to) });
    }
  }
}

/** @param {Point} from @param {Point} to */
function arrow([x, y], [toX, toY]) {
  const length = Math.hypot(toX - x, toY - y);
  if (!(length > 2)) return "";
  const [ux, uy] = [(toX - x) / length, (toY - y) / length];
  const head = Math.min(8, length);
  /** @param {number} side */
  const barb = (side) => `L${toX - head * (ux + side * 0.5 * uy)} ${toY - head * (uy - side * 0.5 * ux)}`;
  return `M${x} ${y}L${toX} ${toY}${barb(1)}M${toX} ${toY}${barb(-1)}`;
}
