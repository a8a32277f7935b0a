// One input of the form, with its label, unit, meaning, range and fault.

import { html, setAttributes } from "./dom.js";
import { isRecord } from "./state.js";

/** @typedef {import("./schema.js").Field} Field */

export class Control {
  /** @type {(value: unknown) => void} */
  onInput = () => {};
  /** Why what is typed cannot be sent; empty when it can. */
  fault = "";
  /** @type {unknown} What the request holds: the last value typed without a fault, or shown. */
  #value;

  /**
   * @param {Field} field
   * @param {HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement} input
   * @param {HTMLElement} element all of it
   * @param {HTMLElement} error where faults are said
   */
  constructor(field, input, element, error) {
    this.field = field;
    this.input = input;
    this.element = element;
    this.error = error;
    input.addEventListener("input", () => this.#read());
  }

  #read() {
    const { value, fault } = read(this.field, this.input.value);
    this.fault = fault;
    this.say(fault);
    if (fault) return;
    this.#value = value;
    this.onInput(value);
  }

  /** What is typed stays as it is, such as "1." or a fault, until the value is another. @param {unknown} value */
  show(value) {
    if (same(value, this.#value)) return;
    this.#value = value;
    this.#write();
  }

  /** Takes back what is typed but cannot be sent. */
  forget() {
    if (this.fault) this.#write();
  }

  #write() {
    this.input.value = write(this.field, this.#value);
    this.fault = "";
    this.say("");
  }

  /** @param {string} fault */
  say(fault) {
    this.error.textContent = fault;
    this.error.hidden = !fault;
    setAttributes(this.input, { "aria-invalid": fault ? "true" : undefined });
  }

  /** Brings it before the eyes and takes the keyboard there. */
  reveal() {
    for (let at = this.input.parentElement; at; at = at.parentElement) {
      if (at instanceof HTMLDetailsElement) at.open = true;
    }
    this.input.focus();
  }
}

/**
 * @param {Field} field
 * @param {string} [owner] whose field it is, where the label does not say it
 */
export function field(field, owner) {
  const id = field.path.join("-");
  const error = html("p", { class: "error", id: `${id}-error`, hidden: true });
  const choices = field.kind === "choice" ? field.options.map(({ value, meaning }) => `${words(value)}: ${meaning}`) : [];
  const [meaning] = field.meaning.split("\n- ");
  const said = [meaning.replaceAll("\n", " "), field.range, ...choices].map(sentence).join(" ");
  const hint = html("p", { class: "hint", id: `${id}-hint` }, said);
  const described = owner ? `${id}-error` : `${id}-hint ${id}-error`;
  const input = setAttributes(inputOf(field), { id, "aria-describedby": described, autocomplete: "off" });
  if (owner) {
    input.setAttribute("aria-label", `${owner} ${field.label.toLowerCase()}, ${field.unit}`);
    input.setAttribute("title", hint.textContent ?? "");
  }
  const label = html("label", { for: id }, field.label, html("span", { class: "unit" }, field.unit && ` ${field.unit}`));
  return new Control(field, input, html("div", { class: `field ${field.kind}` }, label, input, hint, error), error);
}

/** @param {Field} field */
function inputOf(field) {
  if (field.kind === "choice") {
    const [first] = field.options;
    const options = field.options.map(({ value }) => html("option", { value }, words(value)));
    const absent = html("option", { value: "" }, `default (${words(first.value)})`);
    return html("select", {}, absent, ...options);
  }
  if (field.kind === "points") {
    return html("textarea", { rows: 4, spellcheck: "false", placeholder: `${field.axes.join(", ")}\n…a corner a line` });
  }
  const byDefault = /default:? (-?[\d.,]+(?:e-?\d+)?)/i.exec(field.meaning)?.[1].replaceAll(/,|\.$/g, "");
  return html("input", { type: "text", inputmode: "decimal", placeholder: byDefault });
}

/** @param {string} name */
const words = (name) => name.replaceAll("_", " ");

/** @param {string} text */
function sentence(text) {
  return text && text[0].toUpperCase() + text.slice(1) + (text.endsWith(".") ? "" : ".");
}

/**
 * What is typed as a value of the request.
 * @param {Field} field
 * @param {string} text
 * @returns {{ value?: unknown, fault: string }}
 */
function read(field, text) {
  const typed = text.trim();
  if (!typed) return { fault: "" };
  if (field.kind === "choice") return { value: typed, fault: "" };
  if (field.kind === "points") return readPoints(typed, field.axes);
  const value = Number(typed);
  if (!Number.isFinite(value)) {
    const point = typed.includes(",") ? " with a decimal point" : "";
    return { fault: `${field.label} is “${typed}”, must be a number${point}` };
  }
  if (field.whole && !Number.isSafeInteger(value)) {
    const most = Number.isInteger(value)
      ? ` of at most ${Number.MAX_SAFE_INTEGER}, the largest that a browser can send`
      : "";
    return { fault: `${field.label} is ${typed}, must be a whole number${most}` };
  }
  return { value, fault: "" };
}

/** @param {string} text @param {string[]} axes */
function readPoints(text, axes) {
  const value = [];
  for (const [index, line] of text.split("\n").entries()) {
    const numbers = line
      .trim()
      .split(/[\s,;]+/)
      .map(Number);
    if (numbers.length !== axes.length || !numbers.every(Number.isFinite)) {
      return { fault: `line ${index + 1} is “${line.trim()}”, must be ${axes.join(", ")}` };
    }
    value.push(Object.fromEntries(axes.map((axis, at) => [axis, numbers[at]])));
  }
  return { value, fault: "" };
}

/** @param {Field} field @param {unknown} value */
function write(field, value) {
  if (value === undefined || value === null) return "";
  if (field.kind !== "points" || !Array.isArray(value)) return typeof value === "object" ? "" : String(value);
  return value.map((point) => field.axes.map((axis) => (isRecord(point) ? (point[axis] ?? 0) : "")).join(", ")).join("\n");
}

/** @param {unknown} a @param {unknown} b */
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
