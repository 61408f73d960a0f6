"""Sections ``time``, ``sensor``, ``clutter`` and ``targets`` of a scenario: what really happens."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.extended_targets import Extent
from gda_tracker.simulation.schema import key


@dataclass(frozen=True)
class Timing:
    """Section ``time``."""

    scan_period_s: float = key("time between scans", unit="s", minimum=0.0, minimum_excluded=True)
    n_scans: int = key("number of scans", minimum=1, maximum=1_000_000)
    n_initiation_scans: int = key("scans used for labelled initiation, always detected", minimum=2)

    def __post_init__(self) -> None:
        """Refuse more initiation scans than scans."""
        if self.n_initiation_scans >= self.n_scans:
            raise ParameterError(
                f"n_initiation_scans = {self.n_initiation_scans}: allowed is less than n_scans = "
                f"{self.n_scans}"
            )


@dataclass(frozen=True)
class Sensor:
    """Section ``sensor``: a radar that measures range and azimuth."""

    position_m: tuple[float, float] = key("[x East, y North]", unit="m")
    azimuth_std_deg: float = key("azimuth noise", unit="deg", minimum=0.0)
    range_std_m: float = key("range noise", unit="m", minimum=0.0)
    detection_probability: float = key(
        "true P_d; with strengths it follows from them", minimum=0.0, maximum=1.0
    )
    false_alarm_probability: float = key(
        "chance that noise exceeds the threshold; 0: no signal strengths",
        default=0.0,
        minimum=0.0,
        maximum=0.99,
    )
    strength_per_m2: float = key(
        "mean signal strength of 1 m2 at any range, over mean noise power",
        unit="1/m2",
        default=1.0,
        minimum=0.0,
        minimum_excluded=True,
    )
    resolution_range_m: float = key(
        "half of the pairs of targets this far apart in range are one detection; 0: none",
        unit="m",
        minimum=0.0,
        default=0.0,
    )
    resolution_azimuth_deg: float = key(
        "the same in azimuth", unit="deg", minimum=0.0, maximum=180.0, default=0.0
    )
    range_rate_std_mps: float = key(
        "range-rate noise; 0: it measures none", default=0.0, unit="m/s", minimum=0.0
    )
    blind_speed_mps: float = key(
        "range rate with half of P_d, for it drops slow echoes; 0: it does not",
        default=0.0,
        unit="m/s",
        minimum=0.0,
    )

    def __post_init__(self) -> None:
        """Refuse a resolution in one of range and azimuth only."""
        if (self.resolution_range_m > 0.0) != (self.resolution_azimuth_deg > 0.0):
            raise ParameterError(
                f"resolution_range_m = {self.resolution_range_m:g} and resolution_azimuth_deg = "
                f"{self.resolution_azimuth_deg:g}: allowed are two numbers > 0, or 0 and 0"
            )
        if self.resolution_range_m > 0.0 and self.false_alarm_probability > 0.0:
            raise ParameterError(
                f"resolution_range_m = {self.resolution_range_m:g} and false_alarm_probability = "
                f"{self.false_alarm_probability:g}: allowed is 0 for one of them"
            )
        for name in ("range_rate_std_mps", "blind_speed_mps"):
            for other in ("resolution_range_m", "false_alarm_probability"):
                if getattr(self, name) > 0.0 and getattr(self, other) > 0.0:
                    raise ParameterError(
                        f"{name} = {getattr(self, name):g} and {other} = "
                        f"{getattr(self, other):g}: allowed is 0 for one of them"
                    )


@dataclass(frozen=True)
class Clutter:
    """Section ``clutter``: false alarms, uniform in a rectangle, Poisson in number."""

    region_x_m: tuple[float, float] = key("west and east border", unit="m")
    region_y_m: tuple[float, float] = key("south and north border", unit="m")
    mean_false_alarms_per_scan: float = key("Poisson mean", minimum=0.0, maximum=1e6)
    rcs_mean_m2: float = key("mean RCS", unit="m2", minimum=0.0, minimum_excluded=True)
    rcs_swerling: int = key("Swerling model of the RCS", minimum=1, maximum=4)

    def __post_init__(self) -> None:
        """Refuse an empty rectangle."""
        for name in ("region_x_m", "region_y_m"):
            low, high = getattr(self, name)
            if not low < high:
                raise ParameterError(
                    f"{name} = [{low:g}, {high:g}]: allowed is [low, high], low < high"
                )


@dataclass(frozen=True)
class Manoeuvre:
    """A coordinated turn between two scans, which may be fractions; scan 1 is at time 0."""

    start_scan: float = key("scan at which the turn begins", minimum=1.0)
    end_scan: float = key("scan at which it ends", minimum=1.0)
    lateral_acceleration_g: float = key("in units of 9.80665 m/s2", minimum=0.0)
    turn: str = key("side, seen in the direction of flight", choices=("left", "right"))

    def __post_init__(self) -> None:
        """Refuse a turn that ends before it begins."""
        if not self.start_scan < self.end_scan:
            raise ParameterError(
                f"end_scan = {self.end_scan:g}: allowed is more than start_scan = "
                f"{self.start_scan:g}"
            )


@dataclass(frozen=True)
class Stop:
    """A target brakes to a standstill, and speeds up again later to the speed it had."""

    start_scan: float = key("scan at which it begins to brake", minimum=1.0)
    end_scan: float = key("scan at which it begins to speed up", minimum=1.0)
    braking_mps2: float = key(
        "change of speed, both times", unit="m/s2", minimum=0.0, minimum_excluded=True
    )


@dataclass(frozen=True)
class Target:
    """One entry of ``targets``."""

    id: int = key("identity in the truth", minimum=0, maximum=2**31 - 1)
    class_name: str = key("true class")
    rcs_mean_m2: float = key("mean RCS", unit="m2", minimum=0.0, minimum_excluded=True)
    rcs_swerling: int = key("Swerling model of the RCS", minimum=1, maximum=4)
    initial_position_m: tuple[float, float] = key("[x East, y North] at scan 1", unit="m")
    speed_mps: float = key("constant speed", unit="m/s", minimum=0.0)
    initial_heading_deg_ccw_from_north: float = key("heading at scan 1", unit="deg")
    manoeuvres: tuple[Manoeuvre, ...] = ()
    extent: Extent | None = None
    stops: tuple[Stop, ...] = ()

    def __post_init__(self) -> None:
        """Refuse turns that overlap, or of a target that stands still."""
        if self.manoeuvres and self.speed_mps == 0.0:
            raise ParameterError(
                "speed_mps = 0: allowed is more than 0 for a target with manoeuvres"
            )
        for before, after in zip(self.manoeuvres, self.manoeuvres[1:], strict=False):
            if after.start_scan < before.end_scan:
                raise ParameterError(
                    f"start_scan = {after.start_scan:g}: allowed is >= {before.end_scan:g}, the "
                    f"end of the manoeuvre before"
                )
        if self.manoeuvres and self.stops:
            raise ParameterError("stops: allowed are none for a target with manoeuvres")
