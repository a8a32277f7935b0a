// The form: made from the service's schema, bound to the request.

import { field as makeField, Control } from "./field.js";
import { html } from "./dom.js";
import { freeOf, valueAt, withValue } from "./state.js";

/** @typedef {import("./schema.js").Field} Field */
/** @typedef {import("./schema.js").Group} Group */
/** @typedef {import("./state.js").SolveRequest} SolveRequest */

/** Which fields come together, by the beginning of their paths; a field is in the first section that takes it. */
const SECTIONS = [
  { title: "Slip, torque and limits", takes: ["maneuver.slip", "maneuver.torque_", "maneuver.limits"], open: false },
  { title: "Aisle and outline", takes: ["maneuver.keep_in", "robot.footprint"], open: false },
  { title: "Robot", takes: ["robot"], open: false },
  { title: "Payload", takes: ["payload"], open: false },
  { title: "Grid and search", takes: [""], open: false },
];
/** What the page decides by itself, and a guess, whose torques no field takes. */
const NOT_ASKED = ["view", "initial_guess"];
const MOVING_GOAL = "A goal with a velocity or yaw rate: tick Free at both wheel rates. Else they are 0 there, and the wheels slip.";
/** Components that most maneuvers speak of. */
const POSE = ["x_m", "y_m", "heading_rad"];

export class Form {
  /** @type {Control[]} */
  #controls = [];
  /** @type {{ name: string, box: HTMLInputElement }[]} */
  #free = [];
  #guess = html("p", { class: "note", hidden: true });
  /** @type {SolveRequest} */
  #request = {};

  /**
   * @param {HTMLElement} root
   * @param {Group} group
   * @param {(request: SolveRequest) => void} onChange
   */
  constructor(root, group, onChange) {
    this.onChange = onChange;
    const fields = everyField(group).filter(({ path }) => !NOT_ASKED.includes(path[0]));
    root.append(this.#startAndGoal(fields), this.#guess);
    const placed = new Set(fields.filter((field) => isOfState(field) || isPoint(field)));
    for (const { title, takes, open } of SECTIONS) {
      const mine = fields.filter(
        (field) => !placed.has(field) && takes.some((start) => field.path.join(".").startsWith(start)),
      );
      mine.forEach((field) => placed.add(field));
      root.append(
        section(
          title,
          open,
          mine.map((field) => this.#add(makeField(field)).element),
        ),
      );
    }
  }

  /** @param {SolveRequest} request */
  show(request) {
    this.#request = request;
    for (const control of this.#controls) control.show(valueAt(request, control.field.path));
    const free = freeOf(request);
    for (const { name, box } of this.#free) {
      const isGiven = valueAt(request, ["maneuver", "goal", name]) !== undefined;
      box.checked = free.includes(name) || (name.startsWith("wheel_angle") && !isGiven);
      const control = this.#goal(name);
      // One that is being typed again is empty in between, and stays.
      const absent = box.checked ? "free" : POSE.includes(name) ? "as start" : "0";
      control?.input.setAttribute("placeholder", absent);
      if (control) control.input.disabled = box.checked && control.input !== document.activeElement;
    }
    this.#showGuess(request.initial_guess?.torque_left_n_m?.length ?? 0);
  }

  /** What is typed but cannot be sent. @returns {Control[]} */
  unreadable() {
    return this.#controls.filter((control) => control.fault);
  }

  /** Takes back what is typed but cannot be sent: another request comes. */
  forget() {
    for (const control of this.#controls) control.forget();
  }

  clearErrors() {
    for (const control of this.#controls) control.say(control.fault);
  }

  /**
   * Shows faults beside their fields.
   * @param {{ pointer: string, message: string }[]} faults
   * @returns {{ message: string, control: Control | undefined }[]}
   */
  showErrors(faults) {
    return faults.map(({ pointer, message: quoted }) => {
      const message = quoted.replaceAll("`", "");
      const control = this.#controls.find((each) => covers(`#/${each.field.path.join("/")}`, pointer));
      control?.say(message);
      return { message, control };
    });
  }

  /** @param {Control} control */
  #add(control) {
    this.#controls.push(control);
    control.onInput = (value) => this.#change(control.field.path, value);
    return control;
  }

  /** @param {string[]} path @param {unknown} value */
  #change(path, value) {
    const request = withValue(this.#request, path, value);
    this.onChange(/** @type {SolveRequest} */ (request));
  }

  /** Start and goal side by side, a row per component. @param {Field[]} fields */
  #startAndGoal(fields) {
    const states = fields.filter(isOfState);
    const names = [...new Set(states.map(({ path }) => path[2]))];
    const rows = (/** @type {string[]} */ of) => of.flatMap((name) => this.#row(name, states));
    const reference = fields.filter(isPoint).map((field) => this.#add(makeField(field)).element);
    return html(
      "fieldset",
      { class: "states" },
      html("legend", {}, "Start and goal"),
      html("div", { class: "grid" }, ...HEADS.map((head) => html("span", { class: "head" }, head)), ...rows(POSE)),
      section("Velocities and wheel angles", false, [
        html("div", { class: "grid" }, ...rows(names.filter((name) => !POSE.includes(name)))),
        html("p", { class: "hint" }, MOVING_GOAL),
      ]),
      ...reference,
    );
  }

  /** @param {string} name @param {Field[]} states */
  #row(name, states) {
    const [start, goal] = ["start", "goal"].map((which) => {
      const field = states.find(({ path }) => path[1] === which && path[2] === name);
      return field && this.#add(makeField(field, which === "start" ? "Start" : "Goal"));
    });
    if (!start || !goal) return [];
    start.input.setAttribute("placeholder", "0");
    const box = html("input", { type: "checkbox", "aria-label": `Goal ${goal.field.label} is free`, id: `free-${name}` });
    box.addEventListener("change", () => this.#setFree(name, box.checked));
    this.#free.push({ name, box });
    const label = html("span", { class: "label", title: start.field.meaning }, start.field.label, unit(start.field.unit));
    return [label, start.input, goal.input, box, start.error, goal.error];
  }

  /** @param {string} name of a component */
  #goal(name) {
    return this.#controls.find(({ field }) => field.path.join(".") === `maneuver.goal.${name}`);
  }

  /** @param {string} name @param {boolean} isFree */
  #setFree(name, isFree) {
    this.#goal(name)?.forget();
    const others = freeOf(this.#request).filter((each) => each !== name);
    const free = isFree ? [...others, name] : others;
    const path = ["maneuver", "goal"];
    let request = withValue(this.#request, [...path, "free"], free.length ? free : undefined);
    // Absent it is as the start or 0; a wheel angle that is absent is free.
    request = withValue(request, [...path, name], isFree || !name.startsWith("wheel_angle") ? undefined : 0);
    this.onChange(/** @type {SolveRequest} */ (request));
  }

  /** @param {number} count */
  #showGuess(count) {
    this.#guess.hidden = count === 0;
    const remove = html("button", { type: "button", class: "link" }, "Remove it");
    remove.addEventListener("click", () => this.#change(["initial_guess"], undefined));
    this.#guess.replaceChildren(`The request brings a guess of ${count} torques per wheel. `, remove);
  }
}

const HEADS = ["", "Start", "Goal", "Free"];

/** @param {Group} group @returns {Field[]} */
const everyField = (group) => [...group.fields, ...group.groups.flatMap(everyField)];

/** @param {Field} field */
const isOfState = ({ path }) => path[0] === "maneuver" && (path[1] === "start" || path[1] === "goal");

/** @param {Field} field */
const isPoint = ({ path }) => path[1] === "reference_point";

/** @param {string} text */
const unit = (text) => html("span", { class: "unit" }, text && ` ${text}`);

/** @param {string} path @param {string} pointer */
const covers = (path, pointer) => pointer === path || pointer.startsWith(`${path}/`);

/** @param {string} title @param {boolean} open @param {Node[]} children */
function section(title, open, children) {
  return html("details", { open }, html("summary", {}, title), ...children);
}
