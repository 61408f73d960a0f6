"""Hooks of mkdocs: pages and links that lead out of ``docs/``.

On GitHub the README is the first page, and pages of ``docs`` link files of the repository, such as
``../params/basic.yaml``. In the site the README becomes ``index.md``, Markdown files elsewhere in
the repository become pages under their own path, other files are copied to ``files/``, and all
links follow. A link to what does not exist stays as it is, and fails the build with ``--strict``.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
DOCS = "docs/"
COPIES = "files/"
# Outside docs, but at its root in the site.
PLACES = {"README.md": "index.md"}

FENCE = re.compile(r"^(\s*)(`{3,}|~{3,})")
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s]+)((?:\s+\"[^\"]*\")?\))")
EXTERNAL = re.compile(r"^([a-z][a-z0-9+.-]*:|//|#|/)", re.IGNORECASE)
# What a page loads by itself; links that a reader follows may lead anywhere.
LOADED = re.compile(
    r"<(?:script|img|iframe|source)\b[^>]*\bsrc=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|<link\b(?=[^>]*\brel=[\"']?(?:stylesheet|preload|icon))[^>]*"
    r"\bhref=[\"']?(?:https?:)?//[^\"'\s>]+"
)


def place_in_site(path: str) -> str:
    """Where a file of the repository lies in the site; paths with slashes, from the root."""
    if path in PLACES:
        return PLACES[path]
    if path.startswith(DOCS):
        return path[len(DOCS) :]
    return path if path.endswith(".md") else COPIES + path


def place_in_repository(uri: str) -> str:
    """The inverse of :func:`place_in_site`, for pages."""
    for path, place in PLACES.items():
        if uri == place:
            return path
    return DOCS + uri if (ROOT / DOCS / uri).exists() else uri


def linked_file(path: str, link: str) -> str | None:
    """File of the repository that a link on the page ``path`` leads to, ``None`` if to none.

    A folder stands for its ``README.md``.
    """
    if EXTERNAL.match(link):
        return None
    target = posixpath.normpath(posixpath.join(posixpath.dirname(path), link.partition("#")[0]))
    if target.startswith(".."):
        return None
    if (ROOT / target).is_dir():
        target = posixpath.join(target, "README.md")
    return target if (ROOT / target).is_file() else None


def rewrite(markdown: str, path: str) -> str:
    """Text of the page ``path`` of the repository with its links as they are in the site."""
    here = posixpath.dirname(place_in_site(path))

    def follow(match: re.Match[str]) -> str:
        before, link, after = match.groups()
        target = linked_file(path, link)
        if target is None:
            return match[0]
        anchor = link[link.index("#") :] if "#" in link else ""
        return before + posixpath.relpath(place_in_site(target), here or ".") + anchor + after

    return "".join(
        line if fenced else LINK.sub(follow, line) for line, fenced in lines_of(markdown)
    )


def links(markdown: str) -> list[str]:
    """All links of a page outside of code."""
    return [
        found[1]
        for line, fenced in lines_of(markdown)
        if not fenced
        for found in LINK.findall(line)
    ]


def lines_of(markdown: str) -> list[tuple[str, bool]]:
    """Lines of a page and whether each is fenced code."""
    found, fence = [], ""
    for line in markdown.splitlines(keepends=True):
        mark = FENCE.match(line)
        inside = bool(fence)
        if mark and not fence:
            fence = mark[2]
        elif mark and mark[2].startswith(fence) and not line.strip().strip(fence[0]):
            fence = ""
        found.append((line, inside or bool(mark)))
    return found


def outside() -> list[str]:
    """Files beyond ``docs`` that pages of the site lead to, and pages those lead to in turn."""
    pages = [str(p.relative_to(ROOT)) for p in sorted((ROOT / DOCS).rglob("*.md"))]
    seen = list(PLACES)
    waiting = [*pages, *seen]
    while waiting:
        page = waiting.pop(0)
        for link in links((ROOT / page).read_text(encoding="utf-8")):
            target = linked_file(page, link)
            if target is None or target.startswith(DOCS) or target in seen:
                continue
            seen.append(target)
            if target.endswith(".md"):
                waiting.append(target)
    return seen


def on_files(files: Any, config: Any) -> Any:
    """Add the pages and files that lie outside of ``docs``."""
    from mkdocs.structure.files import File, InclusionLevel

    for path in outside():
        uri = place_in_site(path)
        if path.endswith(".md"):
            made = File.generated(config, uri, content=(ROOT / path).read_text(encoding="utf-8"))
            # Found by links alone, unless the navigation names it.
            made.inclusion = InclusionLevel.NOT_IN_NAV
        else:
            made = File.generated(config, uri, abs_src_path=str(ROOT / path))
        files.append(made)
    return files


def on_post_build(config: Any) -> None:
    """Refuse a site that loads anything from another host."""
    from mkdocs.exceptions import PluginError

    for path in sorted(Path(config.site_dir).rglob("*.html")):
        found = LOADED.search(path.read_text(encoding="utf-8"))
        if found:
            raise PluginError(f"{path.name} loads {found[1]}: allowed is nothing from other hosts")


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Let links follow."""
    return rewrite(markdown, place_in_repository(page.file.src_uri))
