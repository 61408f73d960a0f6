"""Tables of measured numbers: Markdown, and their place in a document."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def with_error(mean: float, stderr: float) -> str:
    """Mean +- standard error."""
    return f"{mean:.3f} +- {stderr:.3f}"


def signed(mean: float, stderr: float) -> str:
    """Difference +- standard error."""
    return f"{mean:+.3f} +- {stderr:.3f}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def write_section(document: Path, name: str, content: str) -> None:
    """Put ``content`` between the comments that begin and end a section of a Markdown document.

    Raises
    ------
    ValueError
        If the document has not exactly one such section.
    """
    begin, end = f"<!-- {name}: begin (generated) -->", f"<!-- {name}: end -->"
    text = document.read_text(encoding="utf-8")
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(end) < text.index(begin):
        raise ValueError(f"{document}: needs one {begin} and one {end} after it")
    before, rest = text.split(begin)
    after = rest.split(end)[1]
    document.write_text(f"{before}{begin}\n{content}\n{end}{after}", encoding="utf-8")
