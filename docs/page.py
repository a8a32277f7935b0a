#!/usr/bin/env python3
"""Draws the pictures of the page, page.png and page_dark.png beside this file, again: docs/page.py PROGRAM, the built slipdrive.

Needs PyPI's playwright and pillow, and Debian's chromium (another one by CHROMIUM).
"""

import io
import os
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, expect, sync_playwright

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "page"))
from service import Service

# A README's picture should load at once; the page has few colours.
COLOURS = 128


def draw(browser: Browser, service: Service, file: Path, preset: str, at_s: float, scheme: str) -> None:
    """The page with a solved preset, stopped at a time of its plan."""
    # Without reduced motion the plan would play on.
    look = {"viewport": {"width": 1280, "height": 900}, "color_scheme": scheme, "reduced_motion": "reduce"}
    context = browser.new_context(**look)  # type: ignore[arg-type]
    page = context.new_page()
    page.goto(service.url)
    page.select_option("#preset", preset)
    page.click("#solve")
    expect(page.locator("#figures figure").first).to_be_visible(timeout=30_000)
    end_s = float(page.inner_text("#time").split(" s of ")[1].removesuffix(" s"))
    to = "(bar, share) => { bar.value = share * bar.max; bar.dispatchEvent(new Event('input')); }"
    page.locator("#scrub").evaluate(to, at_s / end_s)
    # Else the button would show that it has the keyboard.
    page.evaluate("() => { document.activeElement?.blur(); scrollTo(0, 0); }")
    page.mouse.move(0, 0)
    shot = Image.open(io.BytesIO(page.screenshot()))
    shot.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file.name}: {page.inner_text('#final-time')}, shown {page.inner_text('#time')}, {file.stat().st_size // 1000} kB")
    context.close()


def main() -> None:
    with sync_playwright() as playwright, Service(Path(sys.argv[1])) as service:
        chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        # Containers have no user namespaces for its sandbox.
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        # Half-way through the braking.
        draw(browser, service, HERE / "page.png", "forward-drive", 1.8, "light")
        draw(browser, service, HERE / "page_dark.png", "warehouse-aisle", 2.0, "dark")
        browser.close()


main()
