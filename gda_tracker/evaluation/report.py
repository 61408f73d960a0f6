"""Reports: one HTML file with everything inside, pictures, tables and styles."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

STYLE = """\
:root { color-scheme: light; --ink: #1f2328; --soft: #59636e; --line: #d8dee4; --accent: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: #f6f8fa; color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2rem 2.5rem 4rem; background: #fff;
  border-inline: 1px solid var(--line); min-height: 100vh; }
h1 { font-size: 1.75rem; line-height: 1.25; margin: 0 0 .4rem; }
h2 { font-size: 1.3rem; margin: 2.6rem 0 .6rem; padding-top: 1rem;
  border-top: 1px solid var(--line); }
p, figcaption, li { max-width: 46rem; }
.lead { color: var(--soft); font-size: 1.05rem; margin-top: 0; }
figure { margin: 1.4rem 0 2rem; }
figure img { max-width: 100%; height: auto; display: block; }
figcaption { color: var(--soft); font-size: .93rem; margin-top: .5rem; }
figcaption b { color: var(--ink); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; }
th, td { padding: .38rem .8rem; border-bottom: 1px solid var(--line); text-align: right;
  vertical-align: top; }
th:first-child, td:first-child { text-align: left; padding-left: 0; font-weight: 500; }
thead th { border-bottom: 2px solid var(--accent); }
table.facts td { text-align: left; font-weight: 400; }
code, pre { font: .88em/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; }
pre { background: #f6f8fa; border: 1px solid var(--line); border-radius: 6px; padding: .8rem 1rem;
  overflow-x: auto; }
details { margin: .6rem 0; }
summary { cursor: pointer; color: var(--accent); }
@media (max-width: 48rem) { main { padding: 1.2rem 1rem 3rem; } }
@media print { body { background: #fff; } main { border: 0; max-width: none; }
  figure { break-inside: avoid; } }
"""


@dataclass(frozen=True)
class Picture:
    """A picture as PNG bytes with a heading and a caption that says how to read it."""

    title: str
    caption: str
    png: bytes


@dataclass(frozen=True)
class Facts:
    """A table of names and values; ``folded`` ones open on a click."""

    title: str
    values: Mapping[str, object]
    folded: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the report, in this order: text, table, code, pictures, facts.

    The first row of ``table`` is its heading.
    """

    title: str
    paragraphs: Sequence[str] = ()
    table: Sequence[Sequence[str]] = ()
    code: str = ""
    pictures: Sequence[Picture] = ()
    facts: Sequence[Facts] = field(default_factory=tuple)


def render(title: str, lead: str, sections: Sequence[Section]) -> str:
    """Return a report as one HTML page that needs no other file and no network.

    All texts are plain text, they are escaped here.
    """
    body = "\n".join(_section(section) for section in sections)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n"
        f'<h1>{html.escape(title)}</h1>\n<p class="lead">{html.escape(lead)}</p>\n'
        f"{body}\n</main>\n</body>\n</html>\n"
    )


def _section(section: Section) -> str:
    parts = [f"<section>\n<h2>{html.escape(section.title)}</h2>"]
    parts += [f"<p>{html.escape(text)}</p>" for text in section.paragraphs]
    if section.table:
        parts.append(_table(section.table))
    if section.code:
        parts.append(f"<pre><code>{html.escape(section.code)}</code></pre>")
    parts += [_figure(picture) for picture in section.pictures]
    parts += [_facts(facts) for facts in section.facts]
    return "\n".join([*parts, "</section>"])


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode("ascii")
    title, caption = html.escape(picture.title), html.escape(picture.caption)
    return (
        f'<figure>\n<img alt="{title}" src="data:image/png;base64,{data}">\n'
        f"<figcaption><b>{title}.</b> {caption}</figcaption>\n</figure>"
    )


def _table(rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{_cell(cell)}</th>' for cell in rows[0])
    body = "\n".join(
        "<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:]
    )
    return (
        f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _cell(text: str) -> str:
    return html.escape(text).replace("+-", "±")


def _facts(facts: Facts) -> str:
    rows = "\n".join(
        f"<tr><td>{html.escape(name)}</td><td>{html.escape(_value(value))}</td></tr>"
        for name, value in facts.values.items()
    )
    table = f'<div class="scroll"><table class="facts">\n{rows}\n</table></div>'
    title = html.escape(facts.title)
    if facts.folded:
        return f"<details>\n<summary>{title}</summary>\n{table}\n</details>"
    return f"<p>{title}</p>\n{table}"


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(_value(item) for item in value)
    return str(value)
