#!/usr/bin/env python3
"""Follow the evidence of one scan round the ring: numbers and pictures of docs/evidence-flow.md.

    python scripts/make_evidence_flow.py          # write the page's numbers and its pictures
    python scripts/make_evidence_flow.py --check  # only say whether the numbers are still true

It tracks simulated runs of the crossing targets with the offline ring, takes the first scan that
shows what the radar cross section is good for (``evidence_flow_case.search`` has the rule), and
writes what each stage made of it between the markers of the page.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

from evidence_flow_case import CHAPTER, KINEMATICS, LIKELIHOOD, RUNS, SEED, Case, search  # noqa: E402
from evidence_flow_page import DETECTIONS, TRACKS, blocks  # noqa: E402

from gda_tracker.evaluation import figures  # noqa: E402

PAGE = ROOT / "docs" / "evidence-flow.md"
IMAGES = ROOT / "docs" / "images"
AROUND = 4
DPI = 100
BLOCK = re.compile(r"(<!-- flow (\w+): begin \(generated\) -->\n).*?(<!-- flow \2: end -->)", re.S)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def filled(page: str, texts: dict[str, str]) -> str:
    """Put the texts between the markers of a page.

    Raises
    ------
    ValueError
        If the page has other markers than there are texts, or one twice.
    """
    found = [match[2] for match in BLOCK.finditer(page)]
    if sorted(found) != sorted(texts):
        raise ValueError(f"blocks of the page: {found}; allowed are {list(texts)}, each once")
    return BLOCK.sub(lambda match: f"{match[1]}{texts[match[2]]}\n{match[3]}", page)


def differences(page: str, fresh: str) -> list[str]:
    """Lines of a page that are not those of a fresh run.

    Numbers may differ by one in the last digit written: that much is left to the rounding of
    another numpy.
    """
    old, new = page.splitlines(), fresh.splitlines()
    lines = [f"- {a}\n+ {b}" for a, b in zip(old, new, strict=False) if not same_line(a, b)]
    if len(old) != len(new):
        lines.append(f"{len(old)} lines, a fresh run writes {len(new)}")
    return lines


def same_line(one: str, other: str) -> bool:
    """Whether two lines have the same words, and numbers equal to one in the last digit."""
    if NUMBER.split(one) != NUMBER.split(other):
        return False
    numbers = zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    return all(
        abs(float(a) - float(b)) <= 1.01 * min(unit(a) or unit(b), unit(b) or unit(a))
        for a, b in numbers
    )


def unit(number: str) -> float:
    """What one in the last digit of a written number is worth, 0 for an integer."""
    digits, _, exponent = number.partition("e")
    decimals = len(digits.partition(".")[2])
    if not decimals and not exponent:
        return 0.0
    return float(10.0 ** (int(exponent or 0) - decimals))


# --- pictures -----------------------------------------------------------------------------------


def pictures(case: Case) -> dict[str, Any]:
    """Figures of the page by file name."""
    result, bayes = case.result(CHAPTER), case.result(LIKELIHOOD)
    names = (TRACKS, DETECTIONS)
    scan, chosen = result.scan, result.associations.chosen
    near = slice(max(case.shown - AROUND, 0), case.shown + AROUND + 1)
    panels = {
        title: [r.tracks for r in case.results[method][near]]
        for title, method in (("RCS off", KINEMATICS), ("RCS on", CHAPTER))
    }
    values = {
        "P_k": case.table(CHAPTER, "associations", "p_kinematic"),
        "d_e": case.table(CHAPTER, "scores", "distance"),
        "P_a": case.table(CHAPTER, "associations", "p_attribute"),
        "P_gen = P_k P_a": case.table(CHAPTER, "associations", "p_generalised"),
        "joint marginal (bayes)": case.table(LIKELIHOOD, "associations", "joint_marginal"),
    }
    alone = case.result(KINEMATICS).associations.chosen[case.pairs()]
    nothing = np.zeros((2, 2), dtype=bool)
    by_chapter = chosen[case.pairs()]
    marks = [alone, nothing, nothing, by_chapter, bayes.associations.chosen[case.pairs()]]
    return {
        "flow_crossing.png": figures.gated_maps(
            panels,
            case.play.detections[near],
            case.play.truth[near],
            case.shown - near.start,
            (scan, result.predictions),
            case.rows,
            DETECTIONS,
            axis_names=("East", "North"),
        ),
        "flow_rcs.png": figures.fuzzy_reading(
            case.rings[CHAPTER].fuzzifier, scan, result.evidence, case.rows, DETECTIONS
        ),
        "flow_histories.png": figures.candidate_histories(
            result.predictions, result.scores, case.pairs(), names, chosen
        ),
        "flow_pairs.png": figures.pair_tables(values, names, marks),
    }


def main(arguments: list[str] | None = None) -> int:
    """Write or check; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    check = parser.parse_args(arguments).check
    case = search(RUNS, SEED)
    page = PAGE.read_text()
    fresh = filled(page, blocks(case))
    if check:
        stale = differences(page, fresh)
        print("\n".join(stale) or f"{PAGE.name} is what a fresh run writes")
        return 1 if stale else 0
    PAGE.write_text(fresh)
    for name, figure in pictures(case).items():
        (IMAGES / name).write_bytes(figures.png(figure, DPI))
        print(f"{name}: {(IMAGES / name).stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
