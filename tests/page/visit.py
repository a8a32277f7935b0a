"""A visit to the page, and what checks of it share."""

import json
import re
import sys
import urllib.request
from pathlib import Path

from playwright.sync_api import Browser, BrowserContext, Page, expect
from service import Service

PROGRAM, AXE = Path(sys.argv[1]), Path(sys.argv[2])
# A search that lasts until it is stopped.
LONG = {"maneuver": {"goal": {"x_m": 3, "y_m": 4, "heading_rad": 2}}, "grid": {"steps": 4000, "control_intervals": 200},
        "solver": {"starts": 64, "time_limit_s": 60, "rollout_limit": 100_000_000}}  # fmt: skip


# Asked for a body that it streams to the page, Chromium has now and then forgotten it.
KEEP_ANSWERS = """
const [send, answers] = [fetch, []];
globalThis.answers = answers;
globalThis.fetch = async (...request) => {
  const response = await send(...request);
  if (String(request[0]).endsWith("solve")) response.clone().text().then((text) => answers.push(text), () => {});
  return response;
};
"""


class Visit:
    """A fresh profile on the page, which notes what is asked for and what goes wrong."""

    def __init__(self, browser: Browser, service: Service, fragment: str = "", **settings: object) -> None:
        self.service = service
        self.context: BrowserContext = browser.new_context(**{"reduced_motion": "reduce", **settings})  # type: ignore[arg-type]
        self.page: Page = self.context.new_page()
        self.page.add_init_script(KEEP_ANSWERS)
        self.requests: list[str] = []
        self.faults: list[str] = []
        self.page.on("request", lambda request: self.requests.append(f"{request.method} {request.url}"))
        self.page.on("console", lambda said: self._note(said.type, said.text))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.faults.append(dialog.message), dialog.dismiss()))
        self.page.goto(f"{service.url}/{fragment}")
        expect(self.page.locator("#preset option").first).to_be_attached()

    def _note(self, kind: str, text: str) -> None:
        # A refusal of the service is said by the browser too.
        if kind in ("error", "warning") and not re.search(r"status of (4\d\d|5\d\d)|ERR_CONNECTION|ERR_INCOMPLETE|ERR_EMPTY", text):
            self.faults.append(text)

    def solve(self) -> dict:
        """Solves by a click; the answer as it came over the wire."""
        self.page.evaluate("answers.length = 0")
        self.page.click("#solve")
        answer = self.answered()
        expect(self.page.locator("#figures figure").first).to_be_visible(timeout=20_000)
        return answer

    def answered(self) -> dict:
        """The next answer that comes to the page."""
        self.service.wait_until(lambda: self.page.evaluate("answers.length > 0"), "an answer comes")
        return result_of(self.page.evaluate("answers.shift()"))

    def close(self) -> None:
        away = [each for each in self.requests if not each.split(" ")[1].startswith((self.service.url, "blob:"))]
        assert not away, f"requests off the host: {away}"
        assert not self.faults, f"faults: {self.faults}"
        self.context.close()


def result_of(events: str) -> dict:
    block = next(block for block in events.split("\n\n") if block.startswith("event: result"))
    return json.loads(block.partition("data: ")[2])


def shown(visit: Visit, name: str) -> str:
    return visit.page.inner_text(f"#{name}")


def slips(answer: dict, contact: str) -> list[str]:
    """Spans in which a contact slips, as the time line says them."""
    spans: list[list] = []
    for span in answer["contact_modes"]:
        if spans and spans[-1][2] == span[contact]:
            spans[-1][1] = span["end_s"]
        else:
            spans.append([span["start_s"], span["end_s"], span[contact]])
    return [f"{start:.2f} to {end:.2f} s" for start, end, mode in spans if mode == "slip"]


def says_what_was_answered(visit: Visit, answer: dict) -> None:
    assert shown(visit, "final-time") == f"{answer['final_time_s']:.4f} s"
    miss = float(shown(visit, "replay-miss").split(" mm")[0]) / 1000
    assert abs(miss - answer["report"]["replay"]["miss_m"]) <= 0.005 * miss
    said = visit.page.get_attribute("#timeline", "aria-label") or ""
    for contact, name in (("left", "Left wheel"), ("right", "Right wheel")):
        spans = slips(answer, contact)
        words = f"{name}: slips from {', '.join(spans)}." if spans else f"{name}: sticks all the time."
        assert words in said, (words, said)


def accessible(visit: Visit, where: str) -> None:
    if not visit.page.evaluate("() => 'axe' in globalThis"):
        visit.page.evaluate(AXE.read_text())
    tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
    found = visit.page.evaluate("tags => axe.run(document, {runOnly: tags})", tags)
    lines = [f"{each['id']}: {node['target']} {node['failureSummary']}" for each in found["violations"] for node in each["nodes"]]
    assert not lines, f"{where}: " + "\n".join(lines)


def fragment_of(request: object) -> str:
    return "#request=" + urllib.request.quote(json.dumps(request), safe="")
