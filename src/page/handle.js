// Start and goal on the floor: dragged, turned by their knob, or moved by keys.

import { setAttributes, svg } from "./dom.js";
import { placing } from "./body.js";

/** @typedef {import("./body.js").Body} Body */
/** @typedef {import("./body.js").Pose} Pose */
/** @typedef {import("./body.js").Point} Point */
/** @typedef {import("./view.js").View} View */

/** @type {Record<string, string>} */
const FREE = { x_m: "x", y_m: "y", heading_rad: "heading" };
/** By a key: metres, and radians; with Shift finer. */
const MOVE_M = [0.1, 0.01];
const TURN_RAD = [Math.PI / 12, Math.PI / 180];
/** Least reach of a knob from the reference point, px. */
const KNOB_PX = 34;

export class Handle {
  #outline = svg("polygon");
  #nose = svg("line");
  #touch = svg("circle", { class: "touch", r: 14 });
  #knob = svg("circle", { class: "knob", r: 12 });
  /** Apart, so that the outline of another does not hide it. */
  name = svg("text", { class: "name", "aria-hidden": "true" });
  /** @type {Pose} */
  #pose = { x: 0, y: 0, heading: 0 };
  /** Whether the pointer has it; the view must not move then. */
  isHeld = false;

  /**
   * @param {"start" | "goal"} which
   * @param {() => View} view
   * @param {(moved: Partial<Pose>) => void} onMove with what moves of it
   * @param {() => void} onRelease
   */
  constructor(which, view, onMove, onRelease) {
    this.label = which === "start" ? "Start" : "Goal";
    this.view = view;
    this.onMove = onMove;
    this.onRelease = onRelease;
    this.name.textContent = this.label;
    const parts = [this.#outline, this.#nose, this.#touch, this.#knob];
    this.element = svg("g", { class: `handle ${which}`, tabindex: 0, role: "button", id: `handle-${which}` }, ...parts);
    this.element.addEventListener("keydown", (event) => this.#onKey(event));
    this.element.addEventListener("pointerdown", (event) => this.#grab(event));
  }

  /** @param {Body} body @param {Pose} pose @param {string[]} free what of it is free */
  show(body, pose, free) {
    this.#pose = pose;
    const open = Object.keys(FREE).filter((name) => free.includes(name)).map((name) => FREE[name]);
    this.name.textContent = open.length ? `${this.label}, ${open.join(", ")} free` : this.label;
    const visibility = free.includes("heading_rad") ? "hidden" : undefined;
    for (const part of [this.#nose, this.#knob]) setAttributes(part, { visibility });
    const [view, place] = [this.view(), placing(body, pose)];
    const corners = body.outline.map((corner) => view.place(place(corner)));
    const at = view.place([pose.x, pose.y]);
    const ahead = view.place([pose.x - Math.sin(pose.heading), pose.y + Math.cos(pose.heading)]);
    const reach = Math.max(KNOB_PX, view.scale * Math.max(...body.outline.map(([, forward]) => forward)) + 16);
    const knob = at.map((from, axis) => from + ((ahead[axis] - from) / view.scale) * reach);
    setAttributes(this.#outline, { points: corners.map((corner) => corner.join(",")).join(" ") });
    setAttributes(this.#nose, { x1: at[0], y1: at[1], x2: knob[0], y2: knob[1] });
    setAttributes(this.#touch, { cx: at[0], cy: at[1] });
    setAttributes(this.#knob, { cx: knob[0], cy: knob[1] });
    const lowest = Math.max(...corners.map(([, y]) => y), at[1] + 14);
    setAttributes(this.name, { x: at[0], y: lowest + 15 });
    const words = `x ${pose.x.toFixed(2)} m, y ${pose.y.toFixed(2)} m, heading ${pose.heading.toFixed(2)} rad`;
    this.element.setAttribute("aria-label", `${this.label}: ${words}. Arrow keys move it, [ and ] turn it.`);
  }

  /** @param {KeyboardEvent} event */
  #onKey(event) {
    const fine = event.shiftKey ? 1 : 0;
    const step = DIRECTIONS[event.key];
    const turn = TURNS[event.key] ?? 0;
    // Many keyboards write [ and ] with AltGr, which comes as Alt, or as Ctrl with Alt.
    const isShortcut = event.metaKey || (step ? event.altKey || event.ctrlKey : event.ctrlKey && !event.altKey);
    if (isShortcut || (!step && !turn)) return;
    event.preventDefault();
    const heading = this.#pose.heading + turn * TURN_RAD[fine];
    this.onMove(step ? this.#moved(step, MOVE_M[fine]) : { heading: rounded(heading, 4) });
  }

  /** The direction is that on the screen, along an axis of the world. @param {Point} step px @param {number} length m */
  #moved(step, length) {
    const { x, y } = this.#pose;
    const [px, py] = this.view().place([x, y]);
    const [toX, toY] = this.view().unplace([px + step[0], py + step[1]]);
    return Math.abs(toX - x) > Math.abs(toY - y)
      ? { x: rounded(x + Math.sign(toX - x) * length) }
      : { y: rounded(y + Math.sign(toY - y) * length) };
  }

  /** @param {PointerEvent} event */
  #grab(event) {
    if (event.button !== 0) return;
    event.preventDefault();
    this.element.focus();
    this.element.setPointerCapture(event.pointerId);
    const turns = event.target === this.#knob;
    const from = this.#world(event);
    const offset = [this.#pose.x - from[0], this.#pose.y - from[1]];
    /** @param {PointerEvent} moved */
    const onMove = (moved) => {
      const [x, y] = this.#world(moved);
      const { x: ownX, y: ownY, heading } = this.#pose;
      const toward = nearTurn(Math.atan2(ownX - x, y - ownY), heading);
      this.onMove(turns ? { heading: rounded(toward, 2) } : { x: rounded(x + offset[0]), y: rounded(y + offset[1]) });
    };
    const onEnd = () => {
      this.element.removeEventListener("pointermove", onMove);
      this.isHeld = false;
      this.onRelease();
    };
    this.isHeld = true;
    this.element.addEventListener("pointermove", onMove);
    this.element.addEventListener("lostpointercapture", onEnd, { once: true });
  }

  /** @param {PointerEvent} event */
  #world(event) {
    const frame = this.element.ownerSVGElement?.getBoundingClientRect();
    return this.view().unplace([event.clientX - (frame?.left ?? 0), event.clientY - (frame?.top ?? 0)]);
  }
}

/** @type {Record<string, Point>} On the screen. */
const DIRECTIONS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** @type {Record<string, number>} */
const TURNS = { "[": 1, "]": -1, "{": 1, "}": -1 };

/** A turn that is the same direction, nearest to another. @param {number} heading @param {number} to */
const nearTurn = (heading, to) => heading + 2 * Math.PI * Math.round((to - heading) / (2 * Math.PI));

/** @param {number} value @param {number} digits */
const rounded = (value, digits = 2) => Number(value.toFixed(digits));
