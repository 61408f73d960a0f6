"""Make the pictures of docs/view.md: the page in Chromium, replaying what is in this repository.

.venv/bin/python scripts/make_view_pictures.py
"""

from __future__ import annotations

import asyncio
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, expect, sync_playwright

from gda_tracker.io.adapters import load_recording
from gda_tracker.resources import resource
from gda_tracker.simulation.playback import Playback, of_recording, of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.tracking.ring import Ring
from gda_tracker.view.history import History
from gda_tracker.view.player import Player
from gda_tracker.view.server import Server

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
SIZE = {"width": 1440, "height": 860}
TIMEOUT_MS = 60_000


@contextmanager
def served(play: Playback, parameters: dict[str, dict[str, Any]], upto: int) -> Iterator[str]:
    """Play ``upto`` scans, and serve them."""
    player = Player(play, parameters, History(), rate=0.0, playing=False)
    player.start()
    for _ in range(upto):
        player.step()
    server = Server(player.history, player, player.status, player=player)
    up, stop, found = threading.Event(), threading.Event(), []

    def ready(address: str) -> None:
        found.append(address)
        up.set()

    thread = threading.Thread(target=lambda: asyncio.run(server.run(ready, stop.is_set)))
    thread.start()
    try:
        up.wait()
        yield found[0]
    finally:
        stop.set()
        thread.join()
        player.close()


def opened(page: Page, address: str, scan: int) -> None:
    """Open the page and wait for a scan."""
    page.goto(address)
    expect(page.locator("body")).to_have_attribute("data-scan", str(scan))


def selected(page: Page, track: int) -> None:
    """Select a track and wait for its chart."""
    page.locator(f'#tracks tr[data-track="{track}"]').click()
    expect(page.locator("#rcs .plot-container")).to_be_visible()
    page.wait_for_timeout(800)


def scenario(name: str, method: str) -> tuple[Playback, dict[str, dict[str, Any]]]:
    """A scenario and its parameters."""
    loaded = load_scenario(name)
    return of_scenario(loaded, 1, 1, method)[0], with_method(tracker_preset(loaded), method)


def busiest(play: Playback, parameters: dict[str, dict[str, Any]]) -> int:
    """Number of the scan with the most pairs to choose from."""
    ring = Ring(parameters)
    if play.initial is not None:
        ring.initialise(play.initial)
    results = [ring.process(detections) for detections in play.detections]
    pairs = [0 if r.associations is None else len(r.associations.hypothesis) for r in results]
    return pairs.index(max(pairs)) + 1


def main() -> int:
    """Make all pictures."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        print("chromium is not installed", file=sys.stderr)
        return 1
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--disable-gpu"]
        )
        # Two aircraft cross; belief masses.
        play, parameters = scenario("crossing_targets", "gda/dsm_classic/cv")
        scan = busiest(play, parameters)
        with served(play, parameters, scan) as address:
            page = browser.new_page(viewport=SIZE, color_scheme="light")
            opened(page, address, scan)
            selected(page, 1)
            for _ in range(2):
                page.keyboard.press("+")
            page.screenshot(path=IMAGES / "view.png")
            page.close()
        # The same with hypothesis trees, dark; a change that is refused, and one that acts.
        play, parameters = scenario("crossing_targets", "mht/bayes/imm")
        scan = busiest(play, parameters)
        with served(play, parameters, scan) as address:
            page = browser.new_page(viewport=SIZE, color_scheme="dark")
            opened(page, address, scan)
            selected(page, 2)
            page.get_by_label("Find a parameter").fill("gate_probability")
            field = page.get_by_label("gate_probability", exact=True)
            field.fill("1.5")
            field.press("Enter")
            expect(page.locator("#answer")).to_have_class("bad")
            page.screenshot(path=IMAGES / "view_dark.png")
            page.close()
        # A real radar on a boat.
        recording = load_recording(resource("data", "autoferry", "scenario16"), "bag")
        preset = {node: dict(values) for node, values in recording.preset.items()}
        with served(of_recording(recording), preset, 40) as address:
            page = browser.new_page(viewport=SIZE, color_scheme="light")
            opened(page, address, 40)
            first = page.locator("#tracks tbody tr").first
            selected(page, int(first.get_attribute("data-track") or 0))
            page.screenshot(path=IMAGES / "view_autoferry.png")
            page.close()
        browser.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
