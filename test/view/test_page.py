"""The page in a real browser: select, pause, step, look back, change a parameter.

Skipped where there is no Chromium; with GDA_TRACKER_BROWSER=required, as in CI, that is a failure.
"""

from __future__ import annotations

import os
import shutil

import pytest
from playwright.sync_api import expect, sync_playwright
from serving import serving

from gda_tracker.simulation.playback import of_scenario, with_method
from gda_tracker.simulation.preset import tracker_preset
from gda_tracker.simulation.scenarios import load_scenario
from gda_tracker.view.encoding import positions
from gda_tracker.view.history import History
from gda_tracker.view.player import Player

REQUIRED = os.environ.get("GDA_TRACKER_BROWSER") == "required"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SLOW_MS = 30_000

if CHROMIUM is None and not REQUIRED:
    pytest.skip("no chromium is installed", allow_module_level=True)

expect.set_options(timeout=SLOW_MS)


@pytest.fixture(scope="module")
def browser():
    assert CHROMIUM, "GDA_TRACKER_BROWSER=required, and no chromium is installed"
    with sync_playwright() as driver:
        # As root, as in containers, Chromium has no sandbox; it loads nothing but our page.
        launched = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        # One context: what does not change is loaded once.
        yield launched.new_context(viewport={"width": 1400, "height": 850})
        launched.close()


@pytest.fixture
def player():
    scenario = load_scenario("crossing_targets")
    method = "gda/dsm_classic/cv"
    play = of_scenario(scenario, 1, 3, method)[0]
    parameters = with_method(tracker_preset(scenario), method)
    made = Player(play, parameters, History(), rate=0.0, playing=False)
    made.start()
    yield made
    made.close()


@pytest.fixture
def open_page(browser):
    """Open pages that must not complain, and must not ask anybody else for anything."""
    pages, faults = [], []

    def open_it(address):
        page = browser.new_page()
        page.set_default_timeout(SLOW_MS)
        pages.append(page)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on(
            "console",
            lambda message: faults.append(message.text) if message.type == "error" else None,
        )
        page.on(
            "request",
            lambda request: (
                faults.append(request.url)
                if not request.url.startswith((address, "ws", "data:", "blob:"))
                else None
            ),
        )
        page.goto(address)
        expect(page.locator("#link")).to_have_text("connected")
        return page

    yield open_it
    for page in pages:
        page.close()
    assert not faults


def shows_scan(page, number):
    expect(page.locator("#where")).to_contain_text(f"scan {number} of")
    expect(page.locator("body")).to_have_attribute("data-scan", str(number))


def picture_at(player, number):
    return player.history.between(number, number)[0][1]


def test_a_session_at_the_page(player, open_page):
    with serving(player) as address:
        page = open_page(address)
        step, back = (
            page.get_by_role("button", name="Step"),
            page.get_by_role("button", name="Back"),
        )

        # Step: two scans, made one at a time.
        step.click()
        shows_scan(page, 1)
        page.keyboard.press("ArrowRight")
        shows_scan(page, 2)
        assert player.history.newest == 2

        # Select a track: its row, its beliefs, its cells.
        tracks = picture_at(player, 2).tracks
        first = int(tracks.track_id[0])
        page.locator(f'#tracks tr[data-track="{first}"]').click()
        expect(page.locator(f'#tracks tr[data-track="{first}"]')).to_have_attribute(
            "aria-selected", "true"
        )
        expect(page.locator("#belief-title")).to_contain_text(f"Track {first} (confirmed")
        bars = page.locator("#bars .bar:not(.mass)")
        expect(bars).to_have_count(3)
        shown = [float(text) for text in bars.locator("span:last-child").all_inner_texts()]
        assert shown == pytest.approx(tracks.class_probability[0], abs=1e-3)
        expect(page.locator("#bars .bar.mass").first).to_be_visible()
        expect(page.locator("#matrix th.selected")).to_have_text(f"track {first}")
        chosen = page.locator("#matrix td.chosen .k span:last-child").first
        expect(chosen).to_contain_text("+")

        # The radar cross sections stand in front of the fuzzy sets.
        points = page.locator("#rcs .scatterlayer .point")
        expect(points.first).to_be_visible()
        expect(page.locator("#rcs .imagelayer image")).to_have_count(1)

        # Play to the end, then look back: with the button, the slider and the keyboard.
        page.get_by_role("button", name="Play").click()
        shows_scan(page, player.total)
        expect(page.locator("#mode")).to_have_text("replay, finished")
        back.click()
        shows_scan(page, player.total - 1)
        page.keyboard.press("Home")
        shows_scan(page, 1)
        page.locator("#slider").fill("5")
        shows_scan(page, 5)
        expect(page.locator("#tracks td").nth(3)).to_have_text(_range_text(player, 5))
        page.locator("body").click(position={"x": 5, "y": 45})
        page.keyboard.press("End")
        shows_scan(page, player.total)


def _range_text(player, number):
    picture = picture_at(player, number)
    x, y = picture.tracks.mean[0, :2] - picture.sensor_xy_m
    distance = (x * x + y * y) ** 0.5
    return f"{distance:.0f}" if distance >= 1000 else f"{distance:.1f}"


def test_pause_stops_the_replay_and_play_goes_on(player, open_page):
    with serving(player) as address:
        page = open_page(address)
        player.set_rate(10.0)  # two scans a second
        player.play()
        expect(page.locator("body")).not_to_have_attribute("data-scan", "0")
        # Before the page knows that it plays, the key would say play.
        expect(page.locator("#mode")).to_have_text("replay")
        page.keyboard.press(" ")
        expect(page.locator("#mode")).to_have_text("replay, paused")
        expect(page.get_by_role("button", name="Play")).to_be_visible()
        at = player.history.newest
        page.wait_for_timeout(1200)
        assert player.history.newest <= at + 1
        player.set_rate(0.0)
        page.keyboard.press(" ")
        shows_scan(page, player.total)


def test_a_parameter_is_changed_and_refused_with_the_reason(player, open_page):
    with serving(player) as address:
        page = open_page(address)
        page.get_by_role("button", name="Step").click()
        shows_scan(page, 1)
        page.get_by_label("Find a parameter").fill("gate_probability")
        field = page.get_by_label("gate_probability", exact=True)
        expect(field).to_have_value("0.99")

        field.fill("1.5")
        field.press("Enter")
        answer = page.locator("#answer")
        expect(answer).to_contain_text("refused: parameter gate_probability = 1.5: allowed is")
        expect(answer).to_have_class("bad")

        field = page.get_by_label("gate_probability", exact=True)
        expect(field).to_have_value("0.99")
        field.fill("0.6")
        field.press("Enter")
        expect(answer).to_contain_text("accepted: gate_probability 0.99 → 0.6, acts from scan 2")
        page.get_by_role("button", name="Step").click()
        shows_scan(page, 2)
        assert picture_at(player, 1).settings.gate_probability == 0.99
        assert picture_at(player, 2).settings.gate_probability == 0.6


def test_two_browsers_and_one_that_may_only_look(player, open_page):
    with serving(player, allow_changes=False) as address:
        pages = [open_page(address), open_page(address)]
        for page in pages:
            expect(page.locator("#parameters-hint")).to_have_text("read only")
            expect(page.get_by_label("decision", exact=True)).to_be_disabled()
            expect(page.get_by_role("button", name="Restart")).to_be_disabled()
        player.play()
        for page in pages:
            shows_scan(page, player.total)
        # Each looks where it wants.
        pages[0].get_by_role("button", name="Back").click()
        shows_scan(pages[0], player.total - 1)
        shows_scan(pages[1], player.total)


def test_the_displays_show_where_tracks_are_and_a_click_selects(player, open_page):
    with serving(player) as address:
        page = open_page(address)
        player.play()
        shows_scan(page, player.total)
        for canvas in ("#plan", "#bscope"):
            label = page.locator(canvas).get_attribute("aria-label")
            assert "2 tracks" in label
            # Something of every sign has been drawn: more than the ground and the grid.
            colours = page.evaluate(
                """(name) => {
                    const c = document.querySelector(name);
                    const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
                    const seen = new Set();
                    for (let i = 0; i < d.length; i += 4) {
                        seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);
                    }
                    return seen.size;
                }""",
                canvas,
            )
            assert colours > 20
        tracks = picture_at(player, player.total).tracks
        x, y = where_drawn(page, player, tracks.mean[1, :2])
        page.locator("#plan").click(position={"x": x, "y": y})
        expect(page.locator("#belief-title")).to_contain_text(f"Track {int(tracks.track_id[1])} ")
        theme = page.evaluate("document.documentElement.dataset.theme")
        page.keyboard.press("t")
        assert page.evaluate("document.documentElement.dataset.theme") != theme
        page.keyboard.press("Escape")
        expect(page.locator("#belief-title")).to_have_text("No track selected")


def test_a_page_that_is_opened_before_the_nodes_answer(player, open_page, monkeypatch):
    values = player.values
    monkeypatch.setattr(player, "values", dict)
    with serving(player) as address:
        page = open_page(address)
        player.step()
        shows_scan(page, 1)
        expect(page.get_by_label("gate_probability", exact=True)).to_have_count(0)
        monkeypatch.setattr(player, "values", values)
        page.wait_for_timeout(3000)  # it asks again every three seconds, with the next scan
        player.step()
        shows_scan(page, 2)
        expect(page.get_by_label("gate_probability", exact=True)).to_have_value("0.99")
        page.keyboard.press("j")
        expect(page.locator("#rcs .imagelayer image")).to_have_count(1)


def where_drawn(page, player, place):
    """Pixels of a place on the plan, worked out from what it shows: everything seen so far."""
    low, high = None, None
    for _, picture in player.history.between(1, 999):
        for points in (positions(picture), picture.tracks.mean[:, :2], [picture.sensor_xy_m]):
            for x, y in points:
                low = (x, y) if low is None else (min(low[0], x), min(low[1], y))
                high = (x, y) if high is None else (max(high[0], x), max(high[1], y))
    box = page.locator("#plan").bounding_box()
    spans = [1.12 * (high[i] - low[i]) for i in (0, 1)]
    scale = min(box["width"] / spans[0], box["height"] / spans[1])
    x = box["width"] / 2 + (place[0] - (low[0] + high[0]) / 2) * scale
    y = box["height"] / 2 - (place[1] - (low[1] + high[1]) / 2) * scale
    return x, y
