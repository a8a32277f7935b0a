// The service's figures, under a common time cursor. Nothing is drawn here but the cursor.

import { html, setAttributes, svg } from "./dom.js";

/** @typedef {import("slipdrive-api").components["schemas"]["Figure"]} Figure */
/** @typedef {import("slipdrive-api").components["schemas"]["AxesMap"]} AxesMap */

export class Figures {
  /** @type {{ line: SVGLineElement, map: AxesMap }[]} */
  #cursors = [];

  /**
   * @param {HTMLElement} root
   * @param {(time: number) => void} onSeek
   */
  constructor(root, onSeek) {
    this.root = root;
    this.onSeek = onSeek;
  }

  /** They are of an earlier plan, until others are shown. */
  showOutdated() {
    setAttributes(this.root, { "aria-busy": "true" });
  }

  /** @param {Figure[]} figures */
  show(figures) {
    setAttributes(this.root, { "aria-busy": undefined });
    this.#cursors = [];
    this.root.replaceChildren(...figures.map((figure) => this.#made(figure)));
  }

  /** @param {number} time s */
  showTime(time) {
    for (const {
      line,
      map: { x },
    } of this.#cursors) {
      const share = (time - x.data[0]) / (x.data[1] - x.data[0]);
      const at = x.px[0] + share * (x.px[1] - x.px[0]);
      setAttributes(line, { x1: at, x2: at, visibility: share >= 0 && share <= 1 ? undefined : "hidden" });
    }
  }

  /** @param {Figure} figure */
  #made({ name, title, caption, svg: text, maps }) {
    const drawing = parsed(text);
    const over = maps.filter(({ x }) => x.quantity === "time_s");
    for (const map of over) {
      const line = svg("line", { class: "cursor", y1: map.y.px[0], y2: map.y.px[1] });
      drawing.append(line);
      this.#cursors.push({ line, map });
    }
    if (over.length) drawing.addEventListener("pointerdown", (event) => this.#seek(event, drawing, over));
    const scroll = html("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": title }, drawing);
    return html("figure", { id: `figure-${name}` }, scroll, html("figcaption", {}, caption));
  }

  /** @param {PointerEvent} event @param {SVGSVGElement} drawing @param {AxesMap[]} maps */
  #seek(event, drawing, maps) {
    const matrix = drawing.getScreenCTM();
    if (!matrix) return;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    const within = maps.find((map) => between(x, map.x.px) && between(y, map.y.px));
    if (!within) return;
    const { data, px } = within.x;
    this.onSeek(data[0] + ((x - px[0]) / (px[1] - px[0])) * (data[1] - data[0]));
  }
}

/** @param {number} value @param {number[]} ends */
const between = (value, [a, b]) => value >= Math.min(a, b) && value <= Math.max(a, b);

/** A drawing of the service; the policy of the page keeps scripts and styles out. @param {string} text */
function parsed(text) {
  const root = new DOMParser().parseFromString(text, "image/svg+xml").documentElement;
  if (!(root instanceof SVGSVGElement)) throw new Error("a figure is no SVG");
  return document.importNode(root, true);
}
