"""From what was seen of a radar to parameters that run: the preset, and what to change in it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.parameter_files import (
    RADAR_INPUT,
    check_parameters,
    known_tables,
    read_preset,
    read_yaml,
    yaml_value,
)
from gda_tracker.io.radar.ego_motion import SensorVelocity
from gda_tracker.io.radar.file_kinds import DETECTIONS
from gda_tracker.io.radar.frames import detections_of_frame, sensor_velocity
from gda_tracker.io.radar.guesses import Guesses, guess
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.inspection import Inspection
from gda_tracker.io.radar.presets import Fit, fits
from gda_tracker.parameters import from_mapping, specifications
from gda_tracker.resources import resource

# A speed of the radar is believed if it makes this share of the points stand still, and none a
# smaller share by this much.
BELIEVED_SHARE, BELIEVED_GAIN = 0.6, 0.2
# A slower motion sideways is noise of the estimate.
SLOW_MPS = 0.2
# Without a preset: clusters and false alarms as in the preset radar_scan.
GENERIC = "radar_scan"


@dataclass(slots=True)
class Recommendation:
    """What fits a topic or file.

    ``preset`` is the name of the one that fits, empty if none does; ``changes`` are parameters by
    node that take the place of its own, with the reason in ``reasons`` by name. ``usable`` is false
    if there is no position among the fields.
    """

    inspection: Inspection
    guesses: Guesses
    fits: list[Fit]
    preset: str = ""
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    velocity: SensorVelocity | None = None
    usable: bool = True
    problem: str = ""

    def change(self, node: str, name: str, value: Any, reason: str) -> None:
        """Put a value in place of the preset's."""
        self.changes.setdefault(node, {})[name] = value
        self.reasons[name] = reason


def recommend(inspection: Inspection) -> Recommendation:
    """Find the preset that fits what was seen, and what has to be changed in it."""
    if inspection.kind == DETECTIONS:
        problem = "these are detections already, which need none"
        return Recommendation(inspection, guess(inspection), [], usable=False, problem=problem)
    ranked = fits(inspection.examples)
    preset = ranked[0].preset if ranked and ranked[0].share > 0.0 else ""
    declared = read_preset(preset).get(RADAR_INPUT, {}) if preset else {}
    table = from_mapping(RadarInputParameters, declared)
    told = dict(entry.split("=", 1) for entry in table.field_names)
    found = Recommendation(inspection, guess(inspection, told), ranked, preset)
    if not preset:
        for name, value in found.guesses.parameters.items():
            found.change(RADAR_INPUT, name, value, "guessed from the values")
    _rcs(found, declared)
    _stamps(found)
    _motion(found)
    _position(found)
    return found


def _rcs(found: Recommendation, declared: dict[str, Any]) -> None:
    usable, guessed = found.guesses.rcs_usable, found.guesses.parameters
    if found.preset:
        wanted = declared.get("rcs_unit", "none")
        if wanted == "none" or "rcs" not in found.guesses.quantities:
            return
        if guessed.get("rcs_offset"):
            found.change(RADAR_INPUT, "rcs_offset", guessed["rcs_offset"], found.guesses.rcs)
            return
        if usable or "declare rcs_unit" in found.guesses.rcs:
            return
        found.change(RADAR_INPUT, "rcs_unit", "none", found.guesses.rcs)
    if not usable:
        reason = "no radar cross section that could be one: kinematics decide alone"
        found.change("track_manager", "attribute_term", "none", reason)


def _stamps(found: Recommendation) -> None:
    stamps = found.inspection.stamps
    if stamps.number and stamps.unset == stamps.number:
        reason = "the driver leaves the stamp empty"
        found.change(RADAR_INPUT, "stamp_source", "received", reason)


def _motion(found: Recommendation) -> None:
    """Set the radar's own speed where only it explains the range rates."""
    table = _radar_input(found)
    found.velocity = sensor_velocity(found.inspection.examples, table)
    one = found.velocity
    if one is None or one.share < BELIEVED_SHARE or one.share - one.share_at_rest < BELIEVED_GAIN:
        return
    if table.sensor_motion == "estimated":
        return
    text = f"{one.share:.0%} of the points then stand still, {one.share_at_rest:.0%} without"
    found.change(RADAR_INPUT, "sensor_speed_mps", round(one.ahead_mps, 2), text)
    if abs(one.left_mps) > SLOW_MPS:
        found.change(RADAR_INPUT, "sensor_speed_left_mps", round(one.left_mps, 2), "as above")


def _position(found: Recommendation) -> None:
    if not found.inspection.examples:
        found.usable, found.problem = False, "no point was seen"
        return
    try:
        detections_of_frame(found.inspection.examples[0], _radar_input(found))
    except UserError as error:
        found.usable, found.problem = False, str(error)


def _radar_input(found: Recommendation) -> RadarInputParameters:
    values = parameters_of(found).get(RADAR_INPUT, {})
    return from_mapping(RadarInputParameters, values)


def parameters_of(found: Recommendation) -> dict[str, dict[str, Any]]:
    """Return the parameters by node: those of the preset with the changes."""
    base = read_preset(found.preset) if found.preset else _generic(found.inspection)
    return {
        node: {**base.get(node, {}), **found.changes.get(node, {})}
        for node in (*base, *(node for node in found.changes if node not in base))
    }


def _generic(inspection: Inspection) -> dict[str, dict[str, Any]]:
    """Parameters for a radar that no preset knows."""
    base = {node: dict(values) for node, values in read_preset(GENERIC).items()}
    distance = inspection.values.get("range")
    if distance is None and {"x", "y"} <= set(inspection.values):
        distance = np.hypot(inspection.values["x"], inspection.values["y"])
    if distance is not None and np.isfinite(distance).any():
        reach = float(np.nanpercentile(distance, 95.0))
        # A room, a street, or the sky.
        base["track_manager"]["range_std_m"] = round(min(max(0.004 * reach, 0.2), 100.0), 2)
        base[RADAR_INPUT]["cluster_distance_m"] = 0.8 if reach < 30.0 else 2.0
        if reach > 2000.0:
            base[RADAR_INPUT]["cluster_distance_m"] = 0.0
            base[RADAR_INPUT]["moving_above_mps"] = 0.0
            base["track_manager"]["max_speed_mps"] = 350.0
    period = inspection.stamps.period_s
    if math.isfinite(period):
        base["track_manager"]["max_gap_s"] = max(2.0, round(12.0 * period, 1))
    return base


def recommended_yaml(found: Recommendation) -> str:
    """Return a parameter file ready to run, with the reasons as comments.

    Raises
    ------
    UserError
        If there is no position among the fields.
    """
    if not found.usable:
        raise UserError(f"{found.inspection.source}: no parameters can be given: {found.problem}")
    head = [
        f"# Parameters for {found.inspection.source} ({found.inspection.kind}),",
        "# written by gda-tracker inspect.",
    ]
    if found.preset:
        head.append(f"# From the preset {found.preset}: {found.fits[0].reason}.")
        text = resource("params", "presets", f"{found.preset}.yaml").read_text(encoding="utf-8")
        for node, values in found.changes.items():
            text = _with_values(text, node, values, found.reasons)
    else:
        head.append(
            "# No preset fits: everything below is guessed. Look at it before you trust it."
        )
        text = _written(parameters_of(found), found.reasons)
    result = "\n".join(head) + "\n" + text
    check_parameters(read_yaml(result, "recommended parameters"), known_tables(), "recommended")
    return result


def _line(node: str, name: str, value: Any) -> str:
    return (
        f"    {name}: {yaml_value(value, specifications(known_tables()[node])[name].element_kind)}"
    )


def _with_values(text: str, node: str, values: dict[str, Any], reasons: dict[str, str]) -> str:
    """Put values into the text of a preset, in place of those that are there."""
    start = text.find(f"/**/{node}:")
    if start < 0:
        return text.rstrip() + "\n\n" + _written({node: values}, reasons)
    end = text.find("\n/**/", start + 1)
    end = len(text) if end < 0 else end
    block = text[start:end]
    for name, value in values.items():
        comment = f"    # Set by inspect: {reasons[name]}."
        line = f"{comment}\n{_line(node, name, value)}"
        pattern = re.compile(rf"^    {name}:.*$", re.MULTILINE)
        if pattern.search(block):
            block = pattern.sub(lambda _, line=line: line, block, count=1)
        else:
            block = block.rstrip("\n") + f"\n{line}\n"
    return text[:start] + block + text[end:]


def _written(parameters: dict[str, dict[str, Any]], reasons: dict[str, str]) -> str:
    blocks = []
    for node, values in parameters.items():
        lines = [f"/**/{node}:", "  ros__parameters:"]
        for name, value in values.items():
            known = specifications(known_tables()[node])[name]
            unit = f" [{known.unit}]" if known.unit else ""
            why = f": {reasons[name]}" if name in reasons else ""
            lines += [f"    # {known.description.split(';')[0]}{unit}{why}"]
            lines += [_line(node, name, value)]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)
