#!/usr/bin/env python3
"""Write the message definitions into docs/topics.md.

python scripts/generate_topic_docs.py            # write
python scripts/generate_topic_docs.py --check    # exit code 1 if the page is out of date
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from doc_tables import write_section  # noqa: E402

MESSAGES = ROOT / "msg_schemas" / "msg"
PAGE = ROOT / "docs" / "topics.md"


def definitions() -> str:
    """All messages, each under its name, as they stand in the files."""
    parts = []
    for path in sorted(MESSAGES.glob("*.msg")):
        text = path.read_text(encoding="utf-8").rstrip()
        parts.append(f"### {path.stem}\n\n```\n{text}\n```")
    return "\n\n".join(parts)


def main() -> int:
    """Write the page, or compare it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    check = parser.parse_args().check
    before = PAGE.read_text(encoding="utf-8")
    write_section(PAGE, "messages", "\n" + definitions() + "\n")
    after = PAGE.read_text(encoding="utf-8")
    if check:
        PAGE.write_text(before, encoding="utf-8")
        if before != after:
            print(f"{PAGE.relative_to(ROOT)}: run python scripts/generate_topic_docs.py")
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
