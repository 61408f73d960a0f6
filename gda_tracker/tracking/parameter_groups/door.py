"""Parameters of the track manager: what comes in: frame, order, limits, statements."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter


@dataclass(frozen=True)
class DoorParameters:
    """What comes in, and in which order."""

    tracking_frame: str = parameter(
        "map", "frame in which sensor poses are given and tracks are published", live=False
    )
    max_detections_per_scan: int = parameter(
        5000, "a scan with more is rejected", minimum=1, maximum=100_000, advanced=True
    )
    time_jump_s: float = parameter(
        10.0,
        "a stamp older than the newest by less is late, by more a restarted time axis (tracks are "
        "reset, ids go on)",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    reorder_window_s: float = parameter(
        0.0,
        "a scan waits until one newer by this has come, so that scans of several sensors that "
        "arrive out of order are worked off in order; 0: each is taken as it comes",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    reorder_sensors: list[str] = parameter(
        [],
        "sensor ids that send regularly: a scan waits no longer once each has sent one at least "
        "as new; only with a reorder_window_s",
        advanced=True,
    )
    reorder_timeout_s: float = parameter(
        1.0,
        "a scan waits for newer ones no longer than this on the clock on the wall; 0: for ever",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    statement_max_age_s: float = parameter(
        60.0,
        "a statement older than the newest scan by more is rejected",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    statement_max_ahead_s: float = parameter(
        60.0,
        "a statement ahead of the newest scan by more is rejected; by less, it waits for its time",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    max_statements: int = parameter(
        20, "statements that may wait for a scan", minimum=1, maximum=1000, advanced=True
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.reorder_window_s > self.time_jump_s:
            raise ParameterError(
                f"parameter reorder_window_s = {self.reorder_window_s}: allowed is at most "
                f"time_jump_s = {self.time_jump_s}"
            )
        if self.reorder_sensors and not self.reorder_window_s:
            raise ParameterError(
                f"parameter reorder_sensors = {self.reorder_sensors}: allowed only with a "
                "reorder_window_s above 0, after which a silent sensor is not waited for"
            )
