// Text to take away: shown whole, so that it can be copied where the clipboard is closed to pages.

import { byId } from "./dom.js";

export class Sheet {
  #dialog = byId("sheet", HTMLDialogElement);
  #text = byId("sheet-text", HTMLTextAreaElement);
  #copy = byId("sheet-copy", HTMLButtonElement);

  constructor() {
    this.#copy.addEventListener("click", () => this.#take());
    byId("sheet-close", HTMLElement).addEventListener("click", () => this.#dialog.close());
  }

  /** @param {string} title @param {string} note @param {string} text */
  show(title, note, text) {
    byId("sheet-title", HTMLElement).textContent = title;
    byId("sheet-note", HTMLElement).textContent = note;
    this.#text.value = text;
    this.#copy.textContent = "Copy";
    this.#dialog.showModal();
    this.#text.select();
  }

  async #take() {
    this.#text.select();
    try {
      await navigator.clipboard.writeText(this.#text.value);
      this.#copy.textContent = "Copied";
    } catch {
      this.#copy.textContent = "Selected: press Ctrl+C";
    }
  }
}
