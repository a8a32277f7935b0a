// From the world to the screen: true scale, y up, or on its side where that fills a wide frame better.

/** @typedef {import("./body.js").Point} Point */

export class View {
  /**
   * @param {number} scale px per metre
   * @param {boolean} onSide y to the right and x down
   * @param {Point} origin where the world's origin is, px
   */
  constructor(scale, onSide, origin) {
    this.scale = scale;
    this.onSide = onSide;
    this.origin = origin;
  }

  /**
   * Shows all points within a frame.
   * @param {Point[]} points
   * @param {{ width: number, height: number }} frame px
   * @param {number} margin px
   */
  static fitting(points, frame, margin) {
    const [lowX, highX] = extent(points.map(([x]) => x));
    const [lowY, highY] = extent(points.map(([, y]) => y));
    const onSide = highY - lowY > 1.2 * (highX - lowX) && frame.width > frame.height;
    const [across, up] = onSide ? [highY - lowY, highX - lowX] : [highX - lowX, highY - lowY];
    const room = [frame.width - 2 * margin, frame.height - 2 * margin];
    const scale = Math.min(room[0] / Math.max(across, 1e-3), room[1] / Math.max(up, 1e-3), MOST_PX_PER_M);
    const view = new View(scale, onSide, [0, 0]);
    return view.centred([(lowX + highX) / 2, (lowY + highY) / 2], frame);
  }

  /** The same, with a point in the middle. @param {Point} point @param {{ width: number, height: number }} frame */
  centred(point, frame) {
    const [x, y] = new View(this.scale, this.onSide, [0, 0]).place(point);
    return new View(this.scale, this.onSide, [frame.width / 2 - x, frame.height / 2 - y]);
  }

  /** @param {Point} point m @returns {Point} px */
  place([x, y]) {
    const [right, up] = this.onSide ? [y, -x] : [x, y];
    return [this.origin[0] + this.scale * right, this.origin[1] - this.scale * up];
  }

  /** @param {Point} pixel @returns {Point} m */
  unplace([px, py]) {
    const [right, up] = [(px - this.origin[0]) / this.scale, (this.origin[1] - py) / this.scale];
    return this.onSide ? [-up, right] : [right, up];
  }

  /** The transform of a group whose units are metres of the world. */
  matrix() {
    const [s, [x, y]] = [this.scale, this.origin];
    return this.onSide ? `matrix(0 ${s} ${s} 0 ${x} ${y})` : `matrix(${s} 0 0 ${-s} ${x} ${y})`;
  }
}

/** A robot of a foot does not fill the frame. */
const MOST_PX_PER_M = 260;

/** @param {number[]} values @returns {[number, number]} */
function extent(values) {
  const finite = values.filter(Number.isFinite);
  return finite.length ? [Math.min(...finite), Math.max(...finite)] : [-1, 1];
}

/** The least of 1, 2 and 5 times a power of ten that is at least so much. @param {number} least */
export function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((digit) => digit * power).find((step) => step >= least * 0.999) ?? 10 * power;
}
