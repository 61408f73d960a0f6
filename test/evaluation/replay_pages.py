"""Reading the report of a replay."""

from __future__ import annotations

from html.parser import HTMLParser


class Page(HTMLParser):
    """Texts of the cells, paragraphs and captions of a page, and its pictures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.pictures: list[str] = []
        self.rows: list[list[str]] = []
        self.headings: list[str] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            assert dict(attributes)["src"].startswith("data:image/png;base64,")
            self.pictures.append(dict(attributes)["alt"])
        elif tag != "meta":
            self._open.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        inside = self._open[-1] if self._open else ""
        if inside in ("td", "th"):
            self.rows[-1].append(data)
        elif inside == "h2":
            self.headings.append(data)
        elif inside in ("p", "figcaption"):
            self.texts.append(data)

    def value(self, name):
        (found,) = {row[1] for row in self.rows if row[0] == name and len(row) == 2}
        return found
