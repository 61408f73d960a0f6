"""What parameters are scored on: recordings with truth, each tracked from its first scan."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.parameters import ParameterError
from gda_tracker.vocabulary.recordings import Recording


@dataclass(frozen=True)
class Case:
    """One recording and how its tracks are scored.

    ``match_distance_m`` is how far a track may be from its target, and the cut-off of GOSPA.
    ``partial`` truth knows some of what the sensor sees: tracks far from all known targets may
    follow something real and are left out.
    """

    name: str
    recording: Recording
    match_distance_m: float
    partial: bool

    def __post_init__(self) -> None:
        if self.recording.truth is None:
            raise ParameterError(
                f"{self.name}: the recording does not bring the true positions of its targets; "
                "give them with --truth (docs/tuning.md)"
            )
        if not 0.0 < self.match_distance_m < float("inf"):
            raise ParameterError(
                f"match_distance_m = {self.match_distance_m}: allowed is a number > 0 [m]"
            )

    @property
    def names_sources(self) -> bool:
        """Whether the truth names the source of every detection, as a simulation does."""
        return all(truth.source_id is not None for truth in self.recording.truth or [])


def fingerprint(cases: Sequence[Case]) -> str:
    """A text that two lists of cases share only if they hold the same scans and truth."""
    digest = hashlib.sha256()
    for case in cases:
        digest.update(f"{case.match_distance_m!r} {case.partial}".encode())
        for scan in case.recording.detections:
            digest.update(f"{scan.sensor_id} {scan.stamp_ns}".encode())
            for values in (scan.range_m, scan.azimuth_rad, scan.range_rate_mps, scan.rcs_m2):
                digest.update(b"-" if values is None else np.asarray(values, "<f8").tobytes())
        for truth in case.recording.truth or []:
            digest.update(np.asarray(truth.target_id, "<i8").tobytes())
            digest.update(np.asarray(truth.target_state, "<f8").tobytes())
            if truth.source_id is not None:
                digest.update(np.asarray(truth.source_id, "<i8").tobytes())
    return digest.hexdigest()[:16]
