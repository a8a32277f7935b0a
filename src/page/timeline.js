// Which contact sticks and which slips, over time.

import { setAttributes, svg } from "./dom.js";
import { roundStep } from "./view.js";

/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {import("./state.js").Span} Span */

const CONTACTS = /** @type {const} */ ([
  ["left", "Left wheel"],
  ["right", "Right wheel"],
  ["front", "Front"],
]);
const ROW_PX = 22;
const NAMES_PX = 84;
const SCALE_PX = 20;
/** Least distance of times on the scale, px. */
const TICK_PX = 64;

export class Timeline {
  #cursor = svg("line", { class: "cursor" });
  #width = 0;
  #duration = 0;
  /** @type {Plan | null} */
  #plan = null;

  /**
   * @param {SVGSVGElement} root
   * @param {(time: number) => void} onSeek
   */
  constructor(root, onSeek) {
    this.root = root;
    /** @param {PointerEvent} event */
    const seek = (event) => onSeek(this.#timeAt(event.clientX));
    root.addEventListener("pointerdown", (event) => {
      root.setPointerCapture(event.pointerId);
      seek(event);
    });
    root.addEventListener("pointermove", (event) => event.buttons && seek(event));
    new ResizeObserver(() => this.show(this.#plan, this.#duration)).observe(root);
  }

  /** @param {Plan | null} plan @param {number} duration s */
  show(plan, duration) {
    setAttributes(this.root, { hidden: !(duration > 0) });
    [this.#plan, this.#duration, this.#width] = [plan, duration, this.root.getBoundingClientRect().width];
    if (!plan || !this.#width) return;
    // A front support without friction slips all the time, which says nothing.
    const rows = CONTACTS.filter(([name]) => name !== "front" || plan.spans.some(({ front }) => front === "stick"));
    const bottom = rows.length * ROW_PX;
    setAttributes(this.root, { viewBox: `0 0 ${this.#width} ${bottom + SCALE_PX}`, height: bottom + SCALE_PX });
    this.root.setAttribute(
      "aria-label",
      `Contact modes. ${rows.map(([name, words]) => inWords(plan.spans, name, words)).join(" ")}`,
    );
    const names = rows.map(([, words], row) => svg("text", { x: 0, y: row * ROW_PX + 15 }, words));
    const bars = rows.flatMap(([name], row) =>
      merged(plan.spans, name).map(({ start_s, end_s, mode }) => this.#bar(start_s, end_s, mode, row)),
    );
    setAttributes(this.#cursor, { y1: 0, y2: bottom });
    this.root.replaceChildren(...names, ...bars, ...this.#scale(bottom), this.#cursor);
  }

  /** @param {number} time s */
  showTime(time) {
    const x = this.#x(time);
    setAttributes(this.#cursor, { x1: x, x2: x });
  }

  /** @param {number} start @param {number} end @param {string} mode @param {number} row */
  #bar(start, end, mode, row) {
    const [x, width] = [this.#x(start), Math.max(0.5, this.#x(end) - this.#x(start))];
    const bar = svg("rect", { x, y: row * ROW_PX + 2, width, height: ROW_PX - 4, class: mode });
    bar.append(svg("title", {}, `${mode}s from ${start.toFixed(3)} s to ${end.toFixed(3)} s`));
    const word = width > 34 ? [svg("text", { x: x + width / 2, y: row * ROW_PX + 15, class: `word ${mode}` }, mode)] : [];
    return svg("g", {}, bar, ...word);
  }

  /** @param {number} y */
  #scale(y) {
    const step = roundStep((this.#duration * TICK_PX) / Math.max(1, this.#width - NAMES_PX));
    if (!(step > 0)) return [];
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    const times = Array.from({ length: Math.floor(this.#duration / step + 1e-9) + 1 }, (_, index) => index * step);
    return times.map((time, index) => {
      const anchor = index === 0 ? "start" : this.#x(time) > this.#width - TICK_PX / 3 ? "end" : "middle";
      return svg(
        "text",
        { x: this.#x(time), y: y + 14, "text-anchor": anchor, class: "scale" },
        `${time.toFixed(digits)} s`,
      );
    });
  }

  /** @param {number} time */
  #x(time) {
    return NAMES_PX + (this.#duration > 0 ? time / this.#duration : 0) * (this.#width - NAMES_PX - 1);
  }

  /** @param {number} clientX */
  #timeAt(clientX) {
    const at = clientX - this.root.getBoundingClientRect().left - NAMES_PX;
    return (this.#duration * at) / (this.#width - NAMES_PX - 1);
  }
}

/** Spans of one contact. @param {Span[]} spans @param {"left" | "right" | "front"} name */
function merged(spans, name) {
  /** @type {{ start_s: number, end_s: number, mode: string }[]} */
  const made = [];
  for (const { start_s, end_s, [name]: mode } of spans) {
    const last = made.at(-1);
    if (last?.mode === mode) last.end_s = end_s;
    else made.push({ start_s, end_s, mode });
  }
  return made;
}

/** @param {Span[]} spans @param {"left" | "right" | "front"} name @param {string} words */
function inWords(spans, name, words) {
  const slips = merged(spans, name).filter(({ mode }) => mode === "slip");
  if (!slips.length) return `${words}: sticks all the time.`;
  return `${words}: slips from ${slips.map(({ start_s, end_s }) => `${start_s.toFixed(2)} to ${end_s.toFixed(2)} s`).join(", ")}.`;
}
