"""Parameters of the track manager: when tracks start, are confirmed and end."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.tracking.extraction import sequential_test
from gda_tracker.tracking.lifecycle import LONGEST_WINDOW

M_OF_N, SEQUENTIAL = "m_of_n", "sequential"
EXTRACTIONS = (M_OF_N, SEQUENTIAL)
INITIATIONS = ("automatic", "labelled")


@dataclass(frozen=True)
class LifeParameters:
    """When tracks start, are confirmed and end."""

    initiation: str = parameter(
        "automatic",
        "automatic: tracks start from detections; labelled: only from initial_tracks, for which "
        "the first scan waits",
        choices=INITIATIONS,
        live=False,
        advanced=True,
    )
    initiation_outside_gates: bool = parameter(
        False,
        "start no track from a detection inside the gate of a confirmed one (several detections "
        "per object)",
        advanced=True,
    )
    initiation_memory_scans: int = parameter(
        2,
        "scans for which a detection without a track waits for a second one",
        minimum=1,
        maximum=LONGEST_WINDOW,
        advanced=True,
    )
    max_tracks: int = parameter(
        2000, "no track starts while so many live", minimum=1, maximum=100_000, advanced=True
    )
    max_gap_s: float = parameter(
        60.0,
        "silence after which the tracks end and new ones start",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    extraction: str = parameter(
        M_OF_N,
        "what confirms and ends tracks: m_of_n (M detections within N scans, misses in a row) or "
        "sequential (likelihood ratio test with the two error probabilities)",
        choices=EXTRACTIONS,
    )
    false_track_probability: float = parameter(
        0.001,
        "sequential: chance that a track started by false detections is confirmed",
        minimum=0.0,
        maximum=1.0,
        minimum_excluded=True,
        advanced=True,
    )
    missed_track_probability: float = parameter(
        0.05,
        "sequential: chance that the track of a target is given up before it is confirmed",
        minimum=0.0,
        maximum=1.0,
        minimum_excluded=True,
        advanced=True,
    )
    confirmation_hits: int = parameter(
        3,
        "M of m_of_n: scans with a detection that confirm a track",
        minimum=2,
        maximum=LONGEST_WINDOW,
    )
    confirmation_scans: int = parameter(
        4, "N of m_of_n: the last scans that are looked at", minimum=2, maximum=LONGEST_WINDOW
    )
    deletion_misses: int = parameter(
        4,
        "m_of_n: scans in a row without a detection that end a confirmed track; 0: never, whatever "
        "the extraction",
        minimum=0,
    )
    tentative_deletion_misses: int = parameter(
        2,
        "m_of_n: scans in a row without a detection that end a tentative track; 0: never",
        minimum=0,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.confirmation_hits > self.confirmation_scans:
            raise ParameterError(
                f"parameter confirmation_hits = {self.confirmation_hits}: allowed is at most "
                f"confirmation_scans = {self.confirmation_scans}"
            )
        sequential_test(self.false_track_probability, self.missed_track_probability)
