"""Reports: one file, nothing from outside, texts as they are."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

from report_examples import swapping_run

from gda_tracker.evaluation.figures import association_maps, png
from gda_tracker.evaluation.report import Facts, Picture, Section, render

NASTY = 'a < b & "c" <script>alert(1)</script>'
VOID = {"meta", "img", "br"}


class Checker(HTMLParser):
    """Collects tags and text, and fails where tags are not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text.append(data)

    def tags(self, name):
        return [attributes for tag, attributes in self.seen if tag == name]


def parse(page: str) -> Checker:
    checker = Checker()
    checker.feed(page)
    checker.close()
    assert checker.open == []
    return checker


def make_page() -> str:
    detections, truth, tracks = swapping_run()
    picture = Picture("Map", NASTY, png(association_maps({"": tracks}, detections, truth)))
    section = Section(
        NASTY,
        [NASTY],
        table=[["", "one"], ["purity", "0.5 +- 0.1"]],
        code="gda-tracker demo --seed 1",
        pictures=[picture],
        facts=[
            Facts("Parameters", {"mean [m2]": [0.3, 1.2000000001], "name": NASTY}, folded=True),
            Facts("Versions", {"numpy": "2.0"}),
        ],
    )
    return render(NASTY, NASTY, [section])


def test_the_page_is_well_formed_and_needs_no_other_file():
    page = make_page()
    found = parse(page)
    assert {tag for tag, _ in found.seen}.isdisjoint({"script", "link", "iframe", "object"})
    assert not re.search(r"url\(|@import|https?:", page)
    for image in found.tags("img"):
        assert image["src"].startswith("data:image/png;base64,")


def test_pictures_are_inside_with_a_text_in_their_place():
    page = make_page()
    (image,) = parse(page).tags("img")
    data = base64.b64decode(image["src"].split(",", 1)[1])
    detections, truth, tracks = swapping_run()
    assert data == png(association_maps({"": tracks}, detections, truth))
    assert image["alt"] == "Map"


def test_texts_appear_as_they_are():
    text = parse(make_page()).text
    # Title twice, lead, section, paragraph, and as a value; the caption follows the picture's name.
    assert sum(piece == NASTY for piece in text) == 6
    assert f" {NASTY}" in text


def test_table_and_facts():
    found = parse(make_page())
    text = "\n".join(found.text)
    assert "0.5 ± 0.1" in text
    assert "0.3, 1.2\n" in text
    assert "gda-tracker demo --seed 1" in text
    assert len(found.tags("details")) == 1
    assert len(found.tags("th")) == 2
