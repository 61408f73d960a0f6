"""Frames of a radar made a recording: which preset, which parameters, what was left out."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.io.adapters.adapter import InputOptions, RecordingError
from gda_tracker.io.parameter_files import RADAR_INPUT, read_preset
from gda_tracker.io.radar.frames import RadarFrame, detections_of_frame, sensor_velocity
from gda_tracker.io.radar.input_parameters import RadarInputParameters
from gda_tracker.io.radar.presets import OF_FILES, best_preset, presets_of
from gda_tracker.kinematics.odometry_buffer import OdometryBuffer
from gda_tracker.kinematics.transform_buffer import TransformBuffer
from gda_tracker.parameters import from_mapping
from gda_tracker.vocabulary.recordings import Recording

# Frames that the preset is guessed by: one may be empty, or all zero by chance.
FRAMES_TO_GUESS_BY = 10
MAX_NAMED = 5  # frames left out that are named one by one
NO_PRESET = "none"
# With a smaller share of points that stand still a wrong speed of the radar is likely.
MOSTLY_STILL = 0.6
# Counts that say something else than that points were left out.
NOT_LEFT_OUT = ("rcs_unknown", "rcs_all_equal", "sensor_motion_unknown")


def recording_of_frames(
    path: Path,
    name: str,
    frames: Iterable[RadarFrame],
    options: InputOptions,
    default_preset: str | None = None,
    fixed: Mapping[str, Any] | None = None,
    transforms: Callable[[], TransformBuffer] | None = None,
    odometry: Callable[[RadarInputParameters], OdometryBuffer] | None = None,
) -> Recording:
    """Make a recording of what a radar published.

    Parameters
    ----------
    path, name
        Of the recording, for errors and reports.
    frames
        In the order in which they were recorded.
    options
        Preset and parameters by the user, these on top of the preset. Without a preset
        ``default_preset`` holds, and without that it is guessed by the fields. The preset ``none``
        stands for the defaults.
    default_preset
        Preset of this kind of recording.
    fixed
        Parameters of the radar input that this kind of recording leaves no choice about.
    transforms
        Reads the transforms of the recording, if it has any.
    odometry
        The same of its odometry.

    Raises
    ------
    RecordingError
        If no preset fits, a preset or parameter does not exist, or no frame could be read.
    """
    first, frames = _peek(frames)
    chosen, guessed = options.preset or default_preset, ""
    if chosen is None:
        chosen, guessed = _guess(path, first, options)
    try:
        preset = {} if chosen == NO_PRESET else read_preset(chosen)
        values = {**preset.get(RADAR_INPUT, {}), **(options.radar_input or {}), **(fixed or {})}
        parameters = from_mapping(RadarInputParameters, values)
    except UserError as error:
        raise RecordingError(str(error)) from error
    recording = Recording(
        name=name,
        detections=[],
        preset={node: table for node, table in preset.items() if node != RADAR_INPUT},
        preset_name=f"{chosen}{guessed}",
        preset_is_base=True,
    )
    known = None
    if parameters.uses_transforms:
        if transforms is None:
            raise RecordingError(
                f"{path}: no transforms in such a file: parameters pose_source and sensor_motion = "
                "'tf' are for bags and live topics"
            )
        known = transforms()
    reports = None
    if parameters.uses_odometry:
        if odometry is None:
            raise RecordingError(
                f"{path}: no odometry in such a file: parameters pose_source and sensor_motion = "
                "'odometry' are for bags and live topics"
            )
        reports = odometry(parameters)
    share = _convert(path, frames, parameters, recording, known, reports)
    if share is not None and share < MOSTLY_STILL:
        _warn_of_motion(first, parameters, recording)
    return recording


def _peek(frames: Iterable[RadarFrame]) -> tuple[list[RadarFrame], Iterable[RadarFrame]]:
    iterator = iter(frames)
    first = list(itertools.islice(iterator, FRAMES_TO_GUESS_BY))
    return first, itertools.chain(first, iterator)


def _guess(path: Path, first: list[RadarFrame], options: InputOptions) -> tuple[str, str]:
    if not first:
        raise RecordingError(f"{path}: no scan could be read")
    found = best_preset(first)
    if found is None and options.radar_input is not None:
        return NO_PRESET, ""
    if found is None:
        known = ", ".join(presets_of(first[0].kind)) or "none for this kind"
        raise RecordingError(
            f"{path}: no preset fits the fields {', '.join(first[0].types)}; name one with "
            f"--preset ({known}, {NO_PRESET}), or declare the fields in a parameter file: "
            f"gda-tracker inspect {path} --yaml FILE"
        )
    by_fields = first[0].kind not in OF_FILES
    return found, " (guessed from the fields)" if by_fields else ""


def _convert(
    path: Path,
    frames: Iterable[RadarFrame],
    parameters: RadarInputParameters,
    recording: Recording,
    transforms: TransformBuffer | None,
    odometry: OdometryBuffer | None,
) -> float | None:
    """Add the scans; return the share of the points that stand still, if that is known."""
    counts: Counter[str] = Counter()
    seen: set[int] = set()
    repeated, still, measured, left_out = 0, 0, 0, []
    for number, frame in enumerate(frames, 1):
        if frame.stamp_ns in seen:
            repeated += 1
            continue
        try:
            scan = detections_of_frame(
                frame,
                parameters,
                len(recording.detections) + 1,
                transforms,
                odometry=odometry,
            )
        except UserError as error:
            left_out.append(f"frame {number} is left out: {error}")
            continue
        seen.add(frame.stamp_ns)
        counts.update(scan.counts)
        if scan.still is not None:
            still, measured = still + int(scan.still.sum()), measured + len(scan.still)
        recording.detections.append(scan.detections)
    if not recording.detections:
        raise RecordingError(
            f"{path}: no scan could be read" + "".join(f"; {line}" for line in left_out[:1])
        )
    recording.warnings += left_out[:MAX_NAMED]
    if len(left_out) > MAX_NAMED:
        recording.warnings.append(f"{len(left_out) - MAX_NAMED} more frames are left out")
    if repeated:
        recording.warnings.append(f"{repeated} scans were sent again and are taken once")
    scans = recording.detections
    number = sum(len(scan.range_m) for scan in scans)
    text = ", ".join(
        f"{count} {why}" for why, count in sorted(counts.items()) if why not in NOT_LEFT_OUT
    )
    recording.notes.append(
        f"{number} detections in {len(scans)} scans" + (f"; left out: {text}" if text else "")
    )
    if measured:
        recording.notes.append(f"standing still: {still / measured:.1%} of the points")
    if parameters.stamp_source == "received":
        recording.notes.append("stamped with the time of recording")
    _warn_of_rcs(parameters, counts, recording)
    return still / measured if measured else None


def _warn_of_motion(
    first: list[RadarFrame], parameters: RadarInputParameters, recording: Recording
) -> None:
    """Say so if another speed of the radar would make most points stand still."""
    found = sensor_velocity(first, parameters)
    if found is not None and found.share >= MOSTLY_STILL:
        recording.warnings.append(
            f"the radar moves: with sensor_speed_mps {found.ahead_mps:.2f} and "
            f"sensor_speed_left_mps {found.left_mps:.2f}, or sensor_motion estimated, "
            f"{found.share:.0%} of the points would stand still"
        )


def _warn_of_rcs(
    parameters: RadarInputParameters, counts: Counter[str], recording: Recording
) -> None:
    if counts["rcs_all_equal"]:
        recording.warnings.append(
            "radar cross section: the same for every point of a scan, hence unknown; kinematics "
            "decide alone"
        )
    elif counts["rcs_unknown"]:
        recording.warnings.append(
            f"radar cross section: {counts['rcs_unknown']} values cannot be one and count as "
            "unknown"
        )
    if parameters.rcs_unit != "none" and all(s.rcs_m2 is None for s in recording.detections):
        recording.warnings.append(
            f"radar cross section: rcs_unit is {parameters.rcs_unit}, but there is no such field"
        )
