"""What ``gda-tracker inspect`` prints about one topic or file."""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.io.radar.inspection import FieldStatistics, Inspection
from gda_tracker.io.radar.recommendation import Recommendation

HEAD = ("field", "type", "n", "min", "median", "max", "NaN", "unit", "meaning")
LEFT = (0, 1, 7, 8)  # columns of text


def report(found: Recommendation) -> str:
    """Return the report, lines of text."""
    seen = found.inspection
    lines = [f"{seen.source}: {seen.kind}", f"  {_frames(seen)}", f"  stamps: {_stamps(seen)}"]
    frames = ", ".join(repr(name) for name in seen.frame_ids)
    unset = ": unset, tracks will have no frame to refer to" if "" in seen.frame_ids else ""
    lines.append(f"  frame: {frames}{unset}")
    if len(seen.layouts) > 1:
        lines.append(f"  the fields change: {len(seen.layouts)} layouts; only the first is shown")
    for text, count in seen.unreadable.most_common(3):
        lines.append(f"  {count} frames cannot be read: {text}")
    lines += ["", *_table(found), ""]
    lines += [f"  {remark}" for remark in found.guesses.remarks]
    lines.append(f"  radar cross section: {found.guesses.rcs}")
    lines += [f"  {line}" for line in _motion(found)]
    lines += [f"  {line}" for line in _preset(found)]
    return "\n".join(lines)


def _frames(seen: Inspection) -> str:
    stamps, points = seen.stamps, seen.points
    text = f"{stamps.number} frames in {stamps.duration_s:.2f} s"
    if math.isfinite(stamps.rate_hz):
        text += f", {stamps.rate_hz:.3g} a second"
    if points:
        least, most = min(points), max(points)
        size = f"{least}" if least == most else f"{least} to {most} (median {np.median(points):g})"
        text += f"; {size} points each"
        empty = points.count(0)
        text += f", {empty} empty" if empty else ""
    return text


def _stamps(seen: Inspection) -> str:
    stamps = seen.stamps
    if stamps.number and stamps.unset == stamps.number:
        return "empty: the driver leaves them 0"
    found = []
    if stamps.steps_back:
        found.append(f"{stamps.steps_back} steps back")
    if stamps.repeated:
        found.append(f"{stamps.repeated} repeated")
    if stamps.gaps:
        found.append(f"{stamps.gaps} gaps, the longest {stamps.longest_gap_s:.3g} s")
    if stamps.unset:
        found.append(f"{stamps.unset} empty")
    text = ", ".join(found) or "in order, no gaps"
    if math.isfinite(stamps.period_s):
        text += f"; period {stamps.period_s:.4g} s, +- {stamps.jitter_s:.2g} s"
    return text


def _table(found: Recommendation) -> list[str]:
    rows = [HEAD, *(_row(found, item) for item in found.inspection.statistics)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    return [
        (
            "  "
            + "  ".join(
                cell.ljust(width) if i in LEFT else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            )
        ).rstrip()
        for row in rows
    ]


def _row(found: Recommendation, item: FieldStatistics) -> tuple[str, ...]:
    return (
        item.name,
        item.type,
        str(item.number),
        *(_number(value) for value in (item.minimum, item.median, item.maximum)),
        f"{item.nan_share:.0%}" if item.nan_share else "-",
        found.guesses.units.get(item.name, ""),
        found.guesses.meaning(item.name) + _note(item),
    )


def _number(value: float) -> str:
    return "-" if not math.isfinite(value) else f"{value:.5g}"


def _note(item: FieldStatistics) -> str:
    if item.number < 10 or not math.isfinite(item.minimum) or item.minimum != item.maximum:
        return ""
    return " (always 0)" if item.minimum == 0.0 else " (constant)"


def _motion(found: Recommendation) -> list[str]:
    one = found.velocity
    if one is None:
        return []
    if "sensor_speed_mps" in found.changes.get("radar_input", {}):
        return [
            f"motion: the radar moves with {one.ahead_mps:.2f} m/s along x and {one.left_mps:.2f} "
            f"m/s along y; {one.share:.0%} of the points then stand still within 1 m/s, without "
            f"{one.share_at_rest:.0%}"
        ]
    share = max(one.share, one.share_at_rest)
    if share < 0.6:
        return [f"motion: no speed of the radar explains most range rates (best {share:.0%})"]
    if one.share - one.share_at_rest < 0.2:
        return [
            f"motion: the radar stands; {one.share_at_rest:.0%} of the points are slower than 1 m/s"
        ]
    return [
        f"motion: the radar moves with {one.ahead_mps:.2f} m/s along x and {one.left_mps:.2f} m/s "
        f"along y, as the preset finds for itself"
    ]


def _preset(found: Recommendation) -> list[str]:
    lines = []
    if found.preset:
        lines.append(f"preset: {found.preset} ({found.fits[0].reason})")
        others = [fit.preset for fit in found.fits[1:] if fit.share > 0.0]
        if others:
            lines.append(f"  also possible: {', '.join(others)}")
    elif found.usable:
        lines.append("preset: none fits; the fields are declared by what was guessed")
        lines += [f"  not {fit.preset}: {fit.reason}" for fit in found.fits[:3]]
    if not found.usable:
        lines.append(f"parameters: {found.problem}")
    for node, values in found.changes.items():
        for name, value in values.items():
            lines.append(f"  {node}: {name} {value} ({found.reasons[name]})")
    return lines
