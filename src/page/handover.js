// Files of a plan for a controller, as `export` makes them.

import { isMet } from "./answer.js";
import { brief, byId } from "./dom.js";
import { download } from "./files.js";
import { listen } from "./state.js";
import { ask } from "./transport.js";

/** @typedef {import("slipdrive-api").components["schemas"]["ExportResponse"]} Exported */

/**
 * Offers the files of the plan that is shown.
 * @param {() => import("slipdrive-api").components["schemas"]["PresentedPlan"] | undefined} shownPlan as `export` takes it
 * @param {(error: unknown) => void} refuse
 */
export function offerFiles(shownPlan, refuse) {
  const said = byId("handed-over", HTMLElement);
  const forget = () => (said.textContent = "");
  listen(["plan"], forget);
  byId("handover", HTMLFormElement).addEventListener("submit", async (event) => {
    event.preventDefault();
    forget();
    const format = byId("format", HTMLSelectElement).value;
    const rate_hz = byId("rate", HTMLInputElement).valueAsNumber;
    try {
      const plan = shownPlan();
      const exported = await ask("export", { ...plan, format, rate_hz });
      for (const { name, media_type, base64 } of exported.files) download(name, media_type, bytesOf(base64));
      const isPlan = !plan?.solve || isMet(plan.solve.answer.status);
      said.textContent = (isPlan ? "" : "This motion does not reach its goal. ") + wordsOf(exported);
    } catch (error) {
      refuse(error);
    }
  });
}

const bytesOf = (/** @type {string} */ base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));

/** @param {Exported} exported */
function wordsOf({ files, miss_m, miss_rad }) {
  const names = files.map(({ name }) => name).join(" and ");
  if (miss_m == null || miss_rad == null) return `${names}: the motion diverges.`;
  const miss = `${brief(1000 * miss_m, 3)} mm and ${brief(miss_rad, 3)} rad`;
  return `${names}: who follows the twist alone, without the torques, ends ${miss} off.`;
}
