// Brings the parts of the page together.

import { showFacts, showMoment, showWords } from "./answer.js";
import { byId, html } from "./dom.js";
import { Figures } from "./figures.js";
import { contentOf, download, savedPlan, savedRequest } from "./files.js";
import { Floor } from "./floor.js";
import { Form } from "./form.js";
import { asCsv, durationOf } from "./motion.js";
import { planOf, stripped } from "./plan.js";
import { Player } from "./player.js";
import { groupOf } from "./schema.js";
import { Sheet } from "./sheet.js";
import { asCurl, asPython, linkTo, requestIn } from "./snippets.js";
import { change, current, isRecord, listen, withValue } from "./state.js";
import { Timeline } from "./timeline.js";
import { ask, Refusal, solve, useKey } from "./transport.js";

/** @typedef {import("./state.js").SolveRequest} SolveRequest */
/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {{ name: string, title: string, request: SolveRequest }} Preset */

const status = byId("status", HTMLElement);
const problem = byId("problem", HTMLElement);
const [solveButton, cancelButton] = [byId("solve", HTMLButtonElement), byId("cancel", HTMLButtonElement)];
const progress = byId("progress", HTMLProgressElement);
const prefersStill = matchMedia("(prefers-reduced-motion: reduce)");

const [schema, limits, presets] = await Promise.all([ask("openapi.json"), ask("limits"), ask("page/presets.json")]).catch(
  (error) => {
    status.textContent = `The page cannot begin: ${error.message}`;
    throw error;
  },
);
/** @type {Record<string, number>} */
const referenceRobot = presets[0].request.robot;

/** The request that the shown answer belongs to. */
let solved = "";
/** @type {AbortController | null} */
let running = null;

const form = new Form(byId("fields", HTMLElement), groupOf(schema, limits, "SolveRequest"), (request) => change({ request }));
const player = new Player((time) => change({ time }));
const seek = (/** @type {number} */ time) => {
  player.pause();
  player.seek(time);
};
const timeline = new Timeline(byId("timeline", SVGSVGElement), seek);
const figures = new Figures(byId("figures", HTMLElement), seek);
const sheet = new Sheet();
const floor = new Floor(byId("floor", SVGSVGElement), referenceRobot, (which, { x, y, heading }) => {
  let request = current().request;
  for (const [name, value] of Object.entries({ x_m: x, y_m: y, heading_rad: heading })) {
    if (!isFree(request, which, name)) request = withValue(request, ["maneuver", which, name], value);
  }
  change({ request });
});

listen(["request"], ({ request }) => {
  form.show(request);
  byId("stale", HTMLElement).hidden = JSON.stringify(request) === solved;
});
listen(["request", "plan", "compared"], (state) => floor.show(state));
listen(["plan"], ({ plan }) => timeline.show(plan, durationOf(plan)));
listen(["time"], (state) => {
  floor.showTime(state);
  timeline.showTime(state.time);
  figures.showTime(state.time);
  showMoment(byId("moment", HTMLElement), state.plan, state.time);
});

/** @param {SolveRequest} request @param {"start" | "goal"} which @param {string} name */
const isFree = (request, which, name) => which === "goal" && (request.maneuver?.goal?.free?.includes(name) ?? false);

/** @param {string} title @param {unknown} error */
function showProblem(title, error) {
  const refusal = error instanceof Refusal ? error.problem : undefined;
  if (refusal?.code === "unauthenticated") byId("access", HTMLDetailsElement).open = true;
  const faults = form.showErrors(refusal?.errors ?? []);
  const lines = faults.map(({ message, control }) => {
    if (!control) return html("li", {}, message);
    const button = html("button", { type: "button", class: "link" }, message);
    button.addEventListener("click", () => control.reveal());
    return html("li", {}, button);
  });
  const words = error instanceof Error ? error.message : String(error);
  const list = lines.length ? [html("ul", {}, ...lines)] : [];
  problem.replaceChildren(html("h2", {}, title), html("p", {}, words), ...list);
  problem.hidden = false;
}

function clearProblem() {
  problem.hidden = true;
  form.clearErrors();
}

/** Whether all that is typed can be read; else the first fault is shown. */
function isReadable() {
  clearProblem();
  const [first] = form.unreadable();
  first?.reveal();
  return !first;
}

async function run() {
  if (!isReadable()) return;
  const request = /** @type {SolveRequest} */ ({ ...current().request, view: "full" });
  const asked = JSON.stringify(current().request);
  running = new AbortController();
  showRunning(true, "Asking the service…");
  try {
    const answer = await solve(request, showEvent, running.signal);
    solved = asked;
    await showPlan({ solve: { request, answer } });
    status.textContent = `Answered: ${answer.status.replaceAll("_", " ")}, ${answer.final_time_s.toFixed(3)} s.`;
  } catch (error) {
    if (running.signal.aborted) status.textContent = "Cancelled.";
    else {
      status.textContent = "";
      showProblem("No answer", error);
    }
  } finally {
    running = null;
    showRunning(false);
  }
}

/** @param {boolean} isRunning @param {string} [words] */
function showRunning(isRunning, words) {
  const hasKeyboard = [solveButton, cancelButton].some((button) => button === document.activeElement);
  [solveButton.hidden, cancelButton.hidden, progress.hidden] = [isRunning, !isRunning, !isRunning];
  if (hasKeyboard) (isRunning ? cancelButton : solveButton).focus();
  if (words) status.textContent = words;
  progress.removeAttribute("value");
}

/** @param {string} name @param {any} data */
function showEvent(name, data) {
  if (name === "queued") {
    status.textContent = data.position ? `Waiting, ${data.position} from the front of the queue…` : "Solving…";
  } else if (name === "progress") {
    const { start, start_count: count, best_final_time_s: time, best_goal_error: error, phase } = data;
    const best = time == null ? "" : `, best ${time.toFixed(3)} s`;
    const missed = error > 1e-3 ? ` with ${error.toPrecision(2)} still missing` : "";
    status.textContent = `${PHASES[phase] ?? "Solving"}: start ${start} of ${count}${best}${missed}`;
    [progress.max, progress.value] = [count, start - 1];
  }
}

/** @type {Record<string, string>} */
const PHASES = { start: "Searching", polish: "Polishing", refinement: "Refining the grid", certificate: "Certifying" };

const longest = () => Math.max(durationOf(current().plan), durationOf(current().compared));

const simulate = (/** @type {unknown} */ body) => ask("simulate", body);

/** @param {Plan["shown"]} shown */
async function showPlan(shown) {
  const plan = await planOf(shown, simulate);
  showFacts(plan);
  byId("answer", HTMLElement).hidden = false;
  byId("stale", HTMLElement).hidden = JSON.stringify(current().request) === solved;
  change({ plan });
  player.load(longest());
  if (!prefersStill.matches && longest() > 0) player.play();
  await showPictures();
}

/** Asked once per answer: cursor, zoom and theme are the page's own. */
async function showPictures() {
  const { plan, compared, time } = current();
  if (!plan) return;
  byId("alone", HTMLElement).hidden = !compared;
  try {
    const answer = await ask("present", { plans: shownPlans() });
    if (plan !== current().plan || compared !== current().compared) return;
    showWords(answer.plans);
    figures.show(answer.figures);
    figures.showTime(time);
  } catch (error) {
    showProblem("No figures", error);
  }
}

/** The plans that are shown, as `present` takes them. */
function shownPlans() {
  const { plan, compared } = current();
  return [plan, compared].flatMap((each) => (each ? [stripped(each)] : []));
}

async function saveReport() {
  try {
    const { report_html: text } = await ask("present", { plans: shownPlans(), report: true });
    download("report.html", "text/html", text);
  } catch (error) {
    showProblem("No report", error);
  }
}

/** @param {HTMLInputElement} input @param {(content: unknown) => Promise<void> | void} use */
function onFile(input, use) {
  input.addEventListener("change", async () => {
    const file = input.files?.[0];
    input.value = "";
    if (!file) return;
    clearProblem();
    try {
      await use(await contentOf(file));
    } catch (error) {
      showProblem(`${file.name} cannot be opened`, error);
    }
  });
}

/** @param {unknown} content */
async function open(content) {
  const shown = savedPlan(content);
  if (!shown) return change({ request: savedRequest(content) });
  if (shown.solve) {
    const request = savedRequest(shown.solve.request);
    solved = JSON.stringify(request);
    change({ request });
  }
  await showPlan(shown);
}

/** @param {unknown} content */
async function compare(content) {
  const shown = savedPlan(content);
  if (!shown) throw new Error("it holds no plan to compare with");
  await showBeside(await planOf(shown, simulate));
}

/** @param {Plan | null} compared */
async function showBeside(compared) {
  change({ compared });
  player.load(longest());
  await showPictures();
}

/** The request as the service completes it, or null after its faults are shown. */
async function validated() {
  if (!isReadable()) return null;
  try {
    const { input_hash: _, ...request } = await ask("validate", current().request);
    return request;
  } catch (error) {
    showProblem("The request has faults", error);
    return null;
  }
}

/** @param {string} id @param {string} title @param {string} note @param {(request: unknown) => string} write */
function onSheet(id, title, note, write) {
  byId(id, HTMLElement).addEventListener("click", async () => {
    const request = await validated();
    if (request) sheet.show(title, note, write(request));
  });
}

/** @param {string} fragment */
function openLink(fragment) {
  try {
    const request = requestIn(fragment);
    if (isRecord(request)) change({ request: savedRequest(request) });
    else if (request !== null) throw new Error("it holds no request");
    return request !== null;
  } catch (error) {
    showProblem("The link cannot be opened", error);
    return true;
  }
}

/** @param {Preset} preset */
const begin = ({ request }) => {
  clearProblem();
  const { view: _, ...rest } = request;
  change({ request: rest });
};

const choice = byId("preset", HTMLSelectElement);
choice.append(...presets.map((/** @type {Preset} */ { name, title }) => html("option", { value: name }, title)));
choice.addEventListener("change", () => begin(presets[choice.selectedIndex]));
byId("key", HTMLInputElement).addEventListener("input", (event) => useKey(/** @type {HTMLInputElement} */ (event.target).value));
for (const id of ["form", "key-form"]) {
  byId(id, HTMLFormElement).addEventListener("submit", (event) => {
    event.preventDefault();
    run();
  });
}
solveButton.addEventListener("click", run);
cancelButton.addEventListener("click", () => running?.abort());
byId("follow", HTMLInputElement).addEventListener("change", (event) => {
  floor.isFollowing = /** @type {HTMLInputElement} */ (event.target).checked;
  floor.refit();
});
byId("save", HTMLElement).addEventListener("click", () => {
  const { plan } = current();
  if (plan) download("plan.json", "application/json", JSON.stringify(plan.shown));
});
byId("csv", HTMLElement).addEventListener("click", () => {
  const { plan } = current();
  if (plan) download("plan.csv", "text/csv", asCsv(plan));
});
byId("report", HTMLElement).addEventListener("click", saveReport);
byId("alone", HTMLElement).addEventListener("click", () => showBeside(null));
onFile(byId("open", HTMLInputElement), open);
onFile(byId("compare", HTMLInputElement), compare);
onSheet("link", "A link that fills the form", "Who opens it sees this maneuver, and solves it by a click.", linkTo);
onSheet("curl", "The same in a shell", "The key, where the service asks for one, is read from SLIPDRIVE_API_KEY.", asCurl);
onSheet("python", "The same in Python", "With the package of this service: clients/python.", asPython);
addEventListener("hashchange", () => openLink(location.hash));

if (!openLink(location.hash)) begin(presets[0]);
