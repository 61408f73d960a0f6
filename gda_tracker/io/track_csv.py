"""Tracks as a table: one row per live track and scan."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from types import TracebackType
from typing import TextIO

import numpy as np

from gda_tracker.io.fields import NANOSECONDS
from gda_tracker.kinematics.extended.ellipses import semi_axes
from gda_tracker.vocabulary.tracks import CONFIRMED, Tracks

# Empty where they are not estimated.
STRENGTHS = ("signal_strength", "signal_strength_std_db", "detection_probability")
COLUMNS = (
    "scan",
    "stamp_s",
    "track_id",
    "status",
    "x_m",
    "y_m",
    "vx_mps",
    "vy_mps",
    "x_std_m",
    "y_std_m",
    "coasted_scans",
    "hits",
    "misses",
    "detection_index",
    "class",
    "class_probability",
    "existence_probability",
    "semi_axis_m",
    "other_semi_axis_m",
    "orientation_rad",
    "expected_detections",
    "detections",
    *STRENGTHS,
)


def decimal_seconds(stamp_ns: int) -> str:
    """Return a stamp [ns] in seconds, exactly, with nine decimals.

    >>> decimal_seconds(1_620_205_606_919_338_123)
    '1620205606.919338123'
    """
    seconds, nanoseconds = divmod(abs(int(stamp_ns)), NANOSECONDS)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{nanoseconds:09d}"


class TrackCsvWriter:
    """Writes tracks to a CSV file, to be used in a ``with`` statement.

    ``scan`` counts from 0; ``status`` is ``tentative`` or ``confirmed``, also while a track coasts;
    ``class`` is the most probable one and empty without classes; ``existence_probability`` is that
    of a target behind the track. Five columns are of extended objects and else empty: the
    ellipse (orientation of its longer axis, counter-clockwise from x), the expected number of
    detections in a scan and that in this one; ``signal_strength`` [mean noise powers], its
    standard deviation [dB] and the ``detection_probability`` that follows are empty where they are
    not estimated.
    Numbers are written so that reading them gives the same float64.

    Parameters
    ----------
    path
        File to write; replaced if it exists.

    Raises
    ------
    OSError
        If it cannot be written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file: TextIO = self.path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def write(self, scan: int, tracks: Tracks) -> None:
        """Write the tracks after one scan, whose state begins with x, y, vx, vy."""
        std = np.sqrt(np.diagonal(tracks.covariance, axis1=1, axis2=2)[:, :2]).tolist()
        mean = tracks.mean[:, :4].tolist()
        stamp = decimal_seconds(tracks.key.stamp_ns)
        ellipses = _ellipses(tracks)
        for row in range(len(tracks)):
            self._writer.writerow(
                (
                    scan,
                    stamp,
                    int(tracks.track_id[row]),
                    "confirmed" if tracks.status[row] == CONFIRMED else "tentative",
                    *map(repr, mean[row]),
                    *map(repr, std[row]),
                    int(tracks.coasted_scans[row]),
                    int(tracks.hits[row]),
                    int(tracks.misses[row]),
                    int(tracks.detection_index[row]),
                    *_class(tracks, row),
                    repr(float(tracks.existence_probability[row])),
                    *ellipses[row],
                    *(_known(float(getattr(tracks, name)[row])) for name in STRENGTHS),
                )
            )

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> TrackCsvWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _known(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _class(tracks: Tracks, row: int) -> tuple[str, str]:
    if not tracks.class_names:
        return "", ""
    probability = tracks.class_probability[row]
    best = int(np.argmax(probability))
    if np.count_nonzero(probability == probability[best]) > 1:
        return "", ""  # nothing is known: naming one of several would be a guess
    return tracks.class_names[best], repr(float(probability[best]))


def _ellipses(tracks: Tracks) -> list[tuple[str, ...]]:
    """The last five columns of each track."""
    if not len(tracks.extent_weight):
        return [("",) * 5] * len(tracks)
    axes, orientation = semi_axes(tracks.extent)
    numbers = np.column_stack([axes, orientation, tracks.expected_detections]).tolist()
    counts = tracks.detection_count.tolist()
    return [(*map(repr, own), str(n)) for own, n in zip(numbers, counts, strict=True)]
