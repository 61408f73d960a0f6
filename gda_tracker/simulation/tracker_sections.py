"""Sections ``tracker`` and ``attribute`` of a scenario: what the tracker is told."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.simulation.schema import key

NOT_KNOWN = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TrackerKnowledge:
    """Section ``tracker``: what the tracker is told about motion, gate, P_d and clutter."""

    process_noise_std_mps2: float = key("sigma_v of the EKF", unit="m/s2", minimum=0.0)
    gate_probability: float = key(
        "chance that the own detection is gated", minimum=0.0, maximum=1.0, minimum_excluded=True
    )
    detection_probability: float = key("P_d as the tracker is told", minimum=0.0, maximum=1.0)
    extraneous_return_density_per_rad_m: float = key("beta", unit="1/(rad m)", minimum=0.0)
    signal_strength: str = key(
        "whether tracks estimate the strength of their target",
        default="none",
        choices=("none", "swerling_1"),
    )
    extraction: str = key(
        "what confirms and ends tracks, if they start by themselves",
        default="m_of_n",
        choices=("m_of_n", "sequential"),
    )
    clutter_density: str = key(
        "whether the tracker takes the density it is told, or estimates it",
        default="given",
        choices=("given", "estimated"),
    )
    resolution: str = key(
        "whether the tracker is told the resolution of the sensor",
        default="told",
        choices=("told", "untold"),
    )
    blind_speed_mps: float = key(
        "blind speed as the tracker is told", default=0.0, unit="m/s", minimum=0.0
    )
    imm_standstill: bool = key("filter imm: a third model that has lost its speed", default=False)
    context_file: str = key(
        "lanes and plans as the tracker is told, a path relative to the scenario's file; empty: "
        "none",
        default="",
    )
    class_motion: str = key(
        "whether speeds and accelerations of the classes are evidence on the class of a track",
        default="off",
        choices=("off", "ranges", "densities"),
    )


@dataclass(frozen=True)
class KnownClass:
    """One entry of ``attribute.classes``: a class the tracker knows."""

    name: str = key("name of the class")
    rcs_mean_m2: float = key("mean RCS", unit="m2", minimum=0.0, minimum_excluded=True)
    rcs_swerling: int = key("Swerling model of the RCS", minimum=1, maximum=4)
    speed_mps: tuple[float, float, float, float] = key(
        "range of its speeds, a <= b <= c <= d; zeros: not known",
        default=NOT_KNOWN,
        unit="m/s",
        minimum=0.0,
    )
    acceleration_mps2: tuple[float, float, float, float] = key(
        "the same of its greatest accelerations", default=NOT_KNOWN, unit="m/s2", minimum=0.0
    )


@dataclass(frozen=True)
class Membership:
    """Section ``attribute.membership``: how an RCS becomes grades of membership."""

    kind: str = key("membership functions", default="histogram", choices=("histogram", "density"))
    n_draws: int = key("draws per histogram", default=10_000, minimum=1, maximum=100_000_000)
    bin_width_m2: float = key(
        "width of a bin", default=0.1, unit="m2", minimum=0.0, minimum_excluded=True
    )
    max_rcs_m2: float = key(
        "end of the last bin", default=30.0, unit="m2", minimum=0.0, minimum_excluded=True
    )
    normalisation: str = key("of the histogram", default="area", choices=("area", "peak"))
    interpolation: str = key("between bin centres", default="linear", choices=("linear", "nearest"))
    seed: int = key("of the draws", default=2004, minimum=0)


@dataclass(frozen=True)
class Attribute:
    """Section ``attribute``: the classes the tracker knows and the readings of the chapter."""

    classes: tuple[KnownClass, ...]
    membership: Membership
    missed_track_hypotheses: str = key(
        "attribute weight of a hypothesis that misses a track although a fuller one exists",
        default="zero",
        choices=("zero", "table_14_3"),
    )
    history_initialisation: str = key(
        "first attribute history of a labelled track",
        default="fuse_initiation_scans",
        choices=("fuse_initiation_scans",),
    )
