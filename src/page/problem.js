// What went wrong, in words, with the way to each field that is at fault.

import { byId, html } from "./dom.js";
import { Refusal } from "./transport.js";

/** @typedef {import("./form.js").Form} Form */

/** So long after the last key. */
const JUDGED_AGAIN_MS = 400;

export class Problem {
  #root = byId("problem", HTMLElement);
  /** Title of the faults of fields that are shown; empty without any. */
  #faulty = "";
  #later = 0;

  /** @param {Form} form */
  constructor(form) {
    this.form = form;
  }

  /** @param {string} title @param {unknown} error */
  show(title, error) {
    this.#draw(title, error);
    this.#root.scrollIntoView({ block: "nearest" });
  }

  /** @param {string} title @param {unknown} error */
  #draw(title, error) {
    const refusal = error instanceof Refusal ? error.problem : undefined;
    if (refusal?.code === "unauthenticated") byId("access", HTMLDetailsElement).open = true;
    const faults = this.form.showErrors(refusal?.errors ?? []).map(({ message, control }) => {
      if (!control) return html("li", {}, message);
      const button = html("button", { type: "button", class: "link" }, message);
      button.addEventListener("click", () => control.reveal());
      return html("li", {}, button);
    });
    const words = error instanceof Error ? error.message : String(error);
    const list = faults.length ? [html("ul", {}, ...faults)] : [];
    this.#faulty = refusal?.errors?.length ? title : "";
    this.#root.replaceChildren(html("h2", {}, title), html("p", {}, words), ...list);
    this.#root.hidden = false;
  }

  /** Faults of fields that are mended go, also those beside other fields. @param {() => Promise<unknown>} judge */
  judgeAgain(judge) {
    clearTimeout(this.#later);
    const title = this.#faulty;
    if (!title) return;
    const mine = (this.#later = setTimeout(async () => {
      const error = await judge().then(() => null, (refusal) => refusal);
      if (mine !== this.#later) return;
      this.clear();
      // What is being typed stays in view.
      if (error) this.#draw(title, error);
    }, JUDGED_AGAIN_MS));
  }

  clear() {
    clearTimeout(this.#later);
    [this.#later, this.#faulty] = [0, ""];
    this.#root.hidden = true;
    this.form.clearErrors();
  }

  /** Whether all that is typed can be read; else the first fault is shown. */
  isReadable() {
    this.clear();
    const [first] = this.form.unreadable();
    first?.reveal();
    return !first;
  }
}
