"""Parameters of the track manager: the node: checkpoint, queues, timeouts."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter


@dataclass(frozen=True)
class OperationParameters:
    """The node: checkpoint, queues, timeouts."""

    checkpoint_path: str = parameter(
        "",
        "file that keeps the tracker's state after each scan, so that a restart goes on; "
        "empty: none",
        live=False,
    )
    state_path: str = parameter(
        "",
        "file that the services save_state and load_state write and read; empty: they refuse",
        advanced=True,
    )
    statements_depth: int = parameter(
        100,
        "history depth of the statements subscription",
        minimum=1,
        maximum=10_000,
        live=False,
        advanced=True,
    )
    queue_depth: int = parameter(
        100, "scans that may wait", minimum=1, maximum=10_000, live=False, advanced=True
    )
    detections_depth: int = parameter(
        100,
        "history depth of the detections subscription, at least queue_depth",
        minimum=1,
        maximum=10_000,
        live=False,
        advanced=True,
    )
    detections_reliability: str = parameter(
        "best_effort",
        "reliability of the detections subscription; best_effort takes both kinds",
        choices=("best_effort", "reliable"),
        live=False,
        advanced=True,
    )
    retry_period_s: float = parameter(
        2.0,
        "age of an open scan at which it is sent again; doubles up to 30 s",
        unit="s",
        minimum=0.1,
        maximum=30.0,
        live=False,
        advanced=True,
    )
    attribute_timeout_s: float = parameter(
        0.0,
        "age of an open scan at which association goes on with kinematics alone; 0: never",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    scan_timeout_s: float = parameter(
        0.0,
        "age of an open scan at which it is given up and tracks are only predicted; 0: never",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    stale_after_s: float = parameter(
        10.0,
        "silence of the input after which diagnostics say stale",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )

    def check(self) -> None:
        """Raise :class:`ParameterError` for values that do not fit together."""
        if self.detections_depth < self.queue_depth:
            raise ParameterError(
                f"parameter detections_depth = {self.detections_depth}: allowed is at least "
                f"queue_depth = {self.queue_depth}"
            )
