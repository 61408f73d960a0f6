"""Parameters of the track manager: what a track's attribute history is made of."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter
from gda_tracker.vocabulary.hypotheses import HISTORY_POLICIES

LONGEST_HISTORY_WINDOW = 100


@dataclass(frozen=True)
class HistoryParameters:
    """What a track's attribute history is made of."""

    history_policy: str = parameter(
        "none",
        "what a track's attribute history is made of: none, all its detections; forgetting, all, "
        "each counting less with every further one; window, the last ones; what this does to "
        "purity is measured in docs/attribute-terms.md",
        choices=HISTORY_POLICIES,
    )
    forgetting_factor: float = parameter(
        1.0,
        "history_policy forgetting: share of the history kept at each detection with a known "
        "attribute, the rest becomes ignorance (bayes: is spread over the possible classes)",
        minimum=0.0,
        maximum=1.0,
    )
    history_window: int = parameter(
        0,
        "history_policy window: how many of a track's last detections with a known attribute its "
        "belief is made of",
        minimum=0,
        maximum=LONGEST_HISTORY_WINDOW,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.history_policy == "forgetting" and self.forgetting_factor >= 1.0:
            raise ParameterError(
                "parameter history_policy = 'forgetting': allowed with a forgetting_factor below "
                f"1, which is {self.forgetting_factor:g}"
            )
        if self.history_policy == "window" and self.history_window < 1:
            raise ParameterError(
                "parameter history_policy = 'window': allowed with a history_window of at least "
                f"1, which is {self.history_window}"
            )

    @property
    def share_kept(self) -> float:
        """Share of the history kept at each detection: the forgetting factor, if that acts."""
        return self.forgetting_factor if self.history_policy == "forgetting" else 1.0

    @property
    def window_rows(self) -> int:
        """Rows of evidence kept of each hypothesis: one less than the window, 0 without one."""
        return self.history_window - 1 if self.history_policy == "window" else 0
