// The clock of the animation: play, pause, scrub, slow motion.

import { byId } from "./dom.js";

/** Steps of the slider over a motion. In seconds the last one could lie beyond the end by rounding, and no browser would go there. */
const STEPS = 1000;

export class Player {
  #button = byId("play", HTMLButtonElement);
  #slider = byId("scrub", HTMLInputElement);
  #speed = byId("speed", HTMLSelectElement);
  #shown = byId("time", HTMLOutputElement);
  #duration = 0;
  #time = 0;
  #frame = 0;

  /** @param {(time: number) => void} onTime s */
  constructor(onTime) {
    this.onTime = onTime;
    this.#button.addEventListener("click", () => (this.#frame ? this.pause() : this.play()));
    this.#slider.addEventListener("input", () => {
      this.pause();
      this.seek((this.#slider.valueAsNumber / STEPS) * this.#duration);
    });
  }

  /** @param {number} duration s */
  load(duration) {
    this.pause();
    this.#duration = duration;
    const isStill = !(duration > 0);
    for (const control of [this.#button, this.#slider, this.#speed]) control.disabled = isStill;
    this.#slider.max = String(STEPS);
    this.seek(0);
  }

  /** @param {number} time s */
  seek(time) {
    this.#time = Math.min(this.#duration, Math.max(0, time));
    this.#slider.value = String(Math.round((this.#time / this.#duration) * STEPS) || 0);
    this.#shown.value = `${this.#time.toFixed(3)} s of ${this.#duration.toFixed(3)} s`;
    this.#slider.setAttribute("aria-valuetext", `${this.#time.toFixed(3)} s`);
    this.onTime(this.#time);
  }

  play() {
    if (this.#time >= this.#duration) this.seek(0);
    let before = performance.now();
    /** @param {number} now */
    const advance = (now) => {
      this.seek(this.#time + ((now - before) / 1000) * Number(this.#speed.value));
      before = now;
      if (this.#time >= this.#duration) this.pause();
      else this.#frame = requestAnimationFrame(advance);
    };
    this.#frame = requestAnimationFrame(advance);
    this.#button.textContent = "Pause";
  }

  pause() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    this.#button.textContent = "Play";
  }
}
