// One search at a time: asked for, watched and cancelled.

import { brief, byId, setAttributes } from "./dom.js";
import { written } from "./state.js";
import { solve } from "./transport.js";

/** @typedef {import("./state.js").SolveRequest} SolveRequest */
/** @typedef {import("./state.js").Solution} Solution */

/** @type {Record<string, string>} What the phases of a search are called. */
const PHASES = { start: "Searching", polish: "Polishing", refinement: "Refining the grid", certificate: "Certifying" };
/** A goal error beyond this is told of, in m, rad, m/s and rad/s. */
const TOLD_ERROR = 1e-3;

export class Search {
  #solve = byId("solve", HTMLButtonElement);
  #cancel = byId("cancel", HTMLButtonElement);
  #progress = byId("progress", HTMLProgressElement);
  #status = byId("status", HTMLElement);
  /** @type {AbortController | null} */
  #running = null;
  /** What it is asked. */
  #asked = "";

  constructor() {
    this.#cancel.addEventListener("click", () => this.stop());
  }

  /** @param {string} words */
  say(words) {
    this.#status.textContent = words;
  }

  /** Ends a search that runs, on its worker too. */
  stop() {
    this.#running?.abort();
  }

  /** Takes back what it said of a search that is over. */
  forget() {
    if (!this.#running) this.say("");
  }

  /**
   * The answer; null where it was cancelled, or where a search runs already.
   * @param {SolveRequest} request
   * @returns {Promise<Solution | null>}
   */
  async run(request) {
    // The second click of a double one; another request takes the place of the one that runs.
    if (this.#running && this.#asked === written(request)) return null;
    this.stop();
    const running = (this.#running = new AbortController());
    this.#asked = written(request);
    const { signal } = running;
    this.#show(true);
    this.say("Asking the service…");
    try {
      const answer = await solve({ ...request, view: "full" }, (name, data) => !signal.aborted && this.#onEvent(name, data), signal);
      if (running !== this.#running) return null;
      const time = answer.final_time_s > 0 ? `, ${answer.final_time_s.toFixed(3)} s` : "";
      this.say(`Answered: ${answer.status.replaceAll("_", " ")}${time}.`);
      return answer;
    } catch (error) {
      if (running === this.#running) this.say(signal.aborted ? "Cancelled." : "");
      if (signal.aborted) return null;
      throw error;
    } finally {
      if (running === this.#running) {
        this.#running = null;
        this.#show(false);
      }
    }
  }

  /** The button is greyed for the maneuver that is searched; another one may be asked for. @param {SolveRequest} request */
  showRequest(request) {
    const isAsked = this.#running && this.#asked === written(request);
    setAttributes(this.#solve, { "aria-disabled": isAsked ? "true" : undefined });
  }

  /** @param {boolean} isRunning */
  #show(isRunning) {
    if (!isRunning && document.activeElement === this.#cancel) this.#solve.focus();
    // It keeps its place and the keyboard: whatever took them would take the second click of a double one.
    setAttributes(this.#solve, { "aria-disabled": isRunning ? "true" : undefined });
    [this.#cancel.hidden, this.#progress.hidden] = [!isRunning, !isRunning];
    this.#progress.removeAttribute("value");
  }

  /** @param {string} name @param {any} data */
  #onEvent(name, data) {
    if (name === "queued") {
      this.say(data.position ? `Waiting, ${data.position} from the front of the queue…` : "Solving…");
    } else if (name === "progress") {
      const { start, start_count: count, best_final_time_s: time, best_goal_error: error, phase } = data;
      const missed = error > TOLD_ERROR ? `, goal missed by ${brief(error, 2)} (m, rad, m/s or rad/s)` : "";
      const best = missed || time == null ? missed : `, best ${time.toFixed(3)} s`;
      this.say(`${PHASES[phase] ?? "Solving"}: start ${start} of ${count}${best}`);
      [this.#progress.max, this.#progress.value] = [count, start - 1];
    }
  }
}
