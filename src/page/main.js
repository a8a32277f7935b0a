// Brings the parts of the page together.

import { showFacts, showMoment, showWords } from "./answer.js";
import { byId, html } from "./dom.js";
import { Figures } from "./figures.js";
import { contentOf, download, savedPlan, savedRequest } from "./files.js";
import { Floor } from "./floor.js";
import { Form } from "./form.js";
import { offerFiles } from "./handover.js";
import { asCsv, durationOf } from "./motion.js";
import { planOf, stripped } from "./plan.js";
import { Player } from "./player.js";
import { Problem } from "./problem.js";
import { groupOf } from "./schema.js";
import { Search } from "./search.js";
import { Sheet } from "./sheet.js";
import { asCurl, asPython, linkTo, requestIn } from "./snippets.js";
import { change, current, freeOf, listen, withValue, written } from "./state.js";
import { Timeline } from "./timeline.js";
import { ask, Refusal, useKey } from "./transport.js";

/** @typedef {import("./state.js").SolveRequest} SolveRequest */
/** @typedef {import("./state.js").Plan} Plan */
/** @typedef {{ name: string, title: string, request: SolveRequest }} Preset */

const prefersStill = matchMedia("(prefers-reduced-motion: reduce)");

const [schema, limits, presets] = await Promise.all([ask("openapi.json"), ask("limits"), ask("page/presets.json")]).catch(
  (error) => {
    byId("status", HTMLElement).textContent = `The page cannot begin: ${error.message}`;
    throw error;
  },
);
/** @type {Record<string, number>} */
const referenceRobot = presets[0].request.robot;

const choice = byId("preset", HTMLSelectElement);
const asTyped = html("option", {}, "As typed");
/** @type {SolveRequest | undefined} The last request that is no preset's. */
let own;
/** The request that the shown answer belongs to; empty where it is none of the form's, but of simulated torques. */
let solved = "";

const form = new Form(byId("fields", HTMLElement), groupOf(schema, limits, "SolveRequest"), (request) =>
  change({ request }),
);
const problem = new Problem(form);
const search = new Search();
const player = new Player((time) => change({ time }));
const seek = (/** @type {number} */ time) => {
  player.pause();
  player.seek(time);
};
const timeline = new Timeline(byId("timeline", SVGSVGElement), seek);
const figures = new Figures(byId("figures", HTMLElement), seek);
const sheet = new Sheet();
const floor = new Floor(byId("floor", SVGSVGElement), referenceRobot, (which, moved) => {
  let request = current().request;
  for (const [name, value] of Object.entries({ x_m: moved.x, y_m: moved.y, heading_rad: moved.heading })) {
    const isMoved = value !== undefined && !isFree(request, which, name);
    if (isMoved) request = withValue(request, ["maneuver", which, name], value);
  }
  change({ request });
});

listen(["request"], ({ request }) => {
  form.show(request);
  search.showRequest(request);
  problem.judgeAgain(() => ask("validate", request));
  showChoice(request);
  showStale();
});
listen(["request", "plan", "compared"], (state) => floor.show(state));
listen(["plan"], ({ plan }) => timeline.show(plan, durationOf(plan)));
listen(["time"], (state) => {
  floor.showTime(state);
  timeline.showTime(state.time);
  figures.showTime(state.time);
  showMoment(byId("moment", HTMLElement), state.plan, state.time);
});

/** Which preset this is, or else that it is the caller's own, to which the way back from a preset leads. @param {SolveRequest} request */
function showChoice(request) {
  const index = presets.findIndex((/** @type {Preset} */ preset) => written(preset.request) === written(request));
  if (index < 0) own = request;
  asTyped.hidden = !own;
  choice.selectedIndex = index < 0 ? presets.length : index;
}

function showStale() {
  byId("stale", HTMLElement).hidden = !solved || solved === written(current().request);
}

/** @param {SolveRequest} request @param {"start" | "goal"} which @param {string} name */
const isFree = (request, which, name) => which === "goal" && freeOf(request).includes(name);

async function run() {
  if (!problem.isReadable()) return search.forget();
  const { request } = current();
  try {
    const answer = await search.run(request);
    if (!answer) return;
    showPlan(await planFrom({ solve: { request: { ...request, view: "full" }, answer } }), request);
  } catch (error) {
    problem.show("No answer", error);
  }
}

const longest = () => Math.max(durationOf(current().plan), durationOf(current().compared));

const planFrom = (/** @type {Plan["shown"]} */ shown) => planOf(shown, (body) => ask("simulate", body), referenceRobot);

/** @param {Plan} plan @param {SolveRequest | null} request of the form that it answers */
function showPlan(plan, request) {
  showFacts(plan, presets[0].request.solver);
  const isStill = !(durationOf(plan) > 0);
  byId("csv", HTMLButtonElement).disabled = isStill;
  byId("handover", HTMLElement).hidden = isStill;
  byId("answer", HTMLElement).hidden = false;
  solved = request ? written(request) : "";
  showStale();
  change({ plan });
  byId("ground", HTMLElement).scrollIntoView({ block: "nearest" });
  player.load(longest());
  if (!prefersStill.matches && longest() > 0) player.play();
  // The animation does not wait for them.
  showPictures();
}

/** Asked once per answer: cursor, zoom and theme are the page's own. */
async function showPictures() {
  const { plan, compared } = current();
  if (!plan) return;
  byId("alone", HTMLElement).hidden = !compared;
  figures.showOutdated();
  const redraw = byId("redraw", HTMLElement);
  redraw.hidden = true;
  const isShown = () => plan === current().plan && compared === current().compared;
  try {
    const answer = await ask("present", { plans: shownPlans() });
    if (!isShown()) return;
    showWords(answer.plans, plan);
    figures.show(answer.figures);
    figures.showTime(current().time);
  } catch (error) {
    if (!isShown()) return;
    figures.show([]);
    redraw.hidden = false;
    problem.show("No figures", error);
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
    problem.show("No report", error);
  }
}

/** @param {HTMLInputElement} input @param {(content: unknown) => Promise<void> | void} use */
function onFile(input, use) {
  input.addEventListener("change", async () => {
    const file = input.files?.[0];
    input.value = "";
    if (!file) return;
    problem.clear();
    try {
      await use(await contentOf(file));
    } catch (error) {
      problem.show(`${file.name} cannot be opened`, error);
    }
  });
}

const requestOf = (/** @type {unknown} */ content) =>
  savedRequest(content, Object.keys(schema.components.schemas.SolveRequest.properties));

/** Another request in place of all that the form has. @param {SolveRequest} request */
function replace(request) {
  form.forget();
  change({ request });
}

/** @param {unknown} content */
async function open(content) {
  const shown = savedPlan(content);
  if (!shown) return replace(requestOf(content));
  // What is wrong with it is found before anything changes.
  const request = shown.solve ? requestOf(shown.solve.request) : null;
  const plan = await planFrom(shown);
  // Its answer would take the place of this plan.
  search.stop();
  search.forget();
  showPlan(plan, request);
  if (request) replace(request);
}

/** @param {unknown} content */
async function compare(content) {
  const shown = savedPlan(content);
  if (!shown) throw new Error("it holds no plan to compare with");
  await showBeside(await planFrom(shown));
}

/** @param {Plan | null} compared */
async function showBeside(compared) {
  change({ compared });
  player.load(longest());
  await showPictures();
}

/** The request as the service completes it, or null after its faults are shown. */
async function validated() {
  if (!problem.isReadable()) return null;
  try {
    const { input_hash: _, ...request } = await ask("validate", current().request);
    return request;
  } catch (error) {
    const isFaulty = error instanceof Refusal && error.problem?.errors?.length;
    problem.show(isFaulty ? "The request has faults" : "No answer", error);
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
  problem.clear();
  try {
    const request = requestIn(fragment);
    if (request === undefined) return;
    replace(requestOf(request));
    // It says what the form was, not what it will be; and the same link may be opened again.
    history.replaceState(null, "", location.pathname + location.search);
  } catch (error) {
    problem.show("The link cannot be opened", error);
  }
}

/** @param {{ request: SolveRequest }} preset */
const begin = ({ request }) => {
  problem.clear();
  const { view: _, ...rest } = request;
  replace(rest);
};

choice.append(...presets.map((/** @type {Preset} */ { name, title }) => html("option", { value: name }, title)), asTyped);
choice.addEventListener("change", () => begin(presets[choice.selectedIndex] ?? { request: own ?? {} }));
byId("key", HTMLInputElement).addEventListener("input", (event) =>
  useKey(/** @type {HTMLInputElement} */ (event.target).value),
);
for (const id of ["form", "key-form"]) {
  byId(id, HTMLFormElement).addEventListener("submit", (event) => {
    event.preventDefault();
    run();
  });
}
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
byId("redraw", HTMLElement).addEventListener("click", () => {
  problem.clear();
  showPictures();
});
byId("alone", HTMLElement).addEventListener("click", () => showBeside(null));
byId("widen", HTMLElement).addEventListener("click", () => {
  const { request } = current();
  // What is left out the service chooses itself.
  change({ request: withValue(withValue(request, ["solver", "starts"], undefined), ["grid", "steps"], undefined) });
  run();
});
offerFiles(
  () => {
    problem.clear();
    return shownPlans()[0];
  },
  (error) => problem.show("No files", error),
);
onFile(byId("open", HTMLInputElement), open);
onFile(byId("compare", HTMLInputElement), compare);
onSheet("link", "A link that fills the form", "Who opens it sees this maneuver, and solves it by a click.", linkTo);
onSheet("curl", "The same in a shell", "The key, where the service asks for one, is read from SLIPDRIVE_API_KEY.", asCurl);
onSheet("python", "The same in Python", "With the package of this service: clients/python.", asPython);
addEventListener("hashchange", () => openLink(location.hash));

// Whoever comes back to the page, or loads it again, finds what was typed.
const [visit] = performance.getEntriesByType("navigation");
const left = sessionStorage.getItem("request");
addEventListener("pagehide", () => sessionStorage.setItem("request", JSON.stringify(current().request)));

begin(presets[0]);
if (left && visit instanceof PerformanceNavigationTiming && visit.type !== "navigate") replace(JSON.parse(left));
else openLink(location.hash);
byId("solve", HTMLButtonElement).disabled = false;
