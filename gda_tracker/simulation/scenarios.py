"""Scenarios: who flies where, what the sensor sees, and what the tracker is told.

A scenario is one YAML file (``params/scenarios``). Everything a tracker may know stands in the
sections ``tracker`` and ``attribute``, and the RCS model of the clutter; the rest is truth and
never reaches it. The key ``monte_carlo`` and keys that start with ``expected_`` are notes: kept,
never interpreted here.

>>> scenario = load_scenario("crossing_targets")
>>> [target.class_name for target in scenario.targets]
['fighter', 'cargo']
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from gda_tracker.parameters import ParameterError
from gda_tracker.resources import resource
from gda_tracker.simulation.extended_targets import ExtendedKnowledge, Extent
from gda_tracker.simulation.schema import ScenarioError, check_keys, check_list, key, read_section
from gda_tracker.simulation.sensor_sections import ModelledSensor, ReachSection, read_sensors
from gda_tracker.simulation.signal_strengths import check_strengths

NOTES = "monte_carlo"
NOTES_PREFIX = "expected_"
NOT_KNOWN = (0.0, 0.0, 0.0, 0.0)


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


@dataclass(frozen=True)
class Scenario:
    """A scenario file, read and checked; ``notes`` are ``monte_carlo`` and ``expected_*``.

    With several ``sensors``, each with a model of its own, ``sensor`` stands for the first of them
    where one noise and one place are asked for, ``reach`` is there, and the tracks start by
    themselves; so they do where ``extended`` tells of targets with several detections a scan.
    """

    name: str
    time: Timing
    sensor: Sensor
    clutter: Clutter
    targets: tuple[Target, ...]
    tracker: TrackerKnowledge
    attribute: Attribute
    sensors: tuple[ModelledSensor, ...] = ()
    reach: ReachSection | None = None
    extended: ExtendedKnowledge | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def only_automatic(self) -> bool:
        """Whether tracks can start by themselves only."""
        return bool(self.sensors) or self.extended is not None


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package: path by name, in alphabetical order."""
    return {path.stem: path for path in sorted(resource("params", "scenarios").glob("*.yaml"))}


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Read and check a scenario.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scenario, or the path of a YAML file.

    Raises
    ------
    ScenarioError
        If there is no such scenario, the file cannot be read, or its contents are not allowed.
    """
    shipped = shipped_scenarios()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.exists():
        raise ScenarioError(
            f"scenario {str(name_or_path)!r}: neither a file nor a shipped scenario; shipped are "
            f"{', '.join(shipped)}"
        )
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"scenario {path}: cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise ScenarioError(f"scenario {path}: not valid YAML: {_one_line(error)}") from None
    scenario = scenario_from_mapping(content, f"scenario {path}")
    if not scenario.tracker.context_file:
        return scenario
    told = path.resolve().parent / scenario.tracker.context_file
    return replace(scenario, tracker=replace(scenario.tracker, context_file=str(told)))


def scenario_from_mapping(content: Any, where: str = "scenario") -> Scenario:
    """Check the contents of a scenario file; ``where`` begins every message.

    Raises
    ------
    ScenarioError
        Naming the section, the key, its value and what is allowed.
    """
    several = isinstance(content, Mapping) and "sensors" in content
    sections = ["name", "time", "clutter", "targets", "tracker", "attribute"]
    sections += ["sensors", "reach"] if several else ["sensor"]
    extended = isinstance(content, Mapping) and "extended" in content
    sections += ["extended"] if extended else []
    notes = {}
    if isinstance(content, Mapping):
        notes = {k: v for k, v in content.items() if k == NOTES or str(k).startswith(NOTES_PREFIX)}
        content = {k: v for k, v in content.items() if k not in notes}
    check_keys(content, sections, sections, where)
    name = content["name"]
    if not isinstance(name, str) or not name:
        raise ScenarioError(f"{where}: name = {name!r}: allowed is a text")
    attribute = _read_attribute(content["attribute"], f"{where}: attribute")
    targets = tuple(
        _read_target(entry, f"{where}: targets[{index}]")
        for index, entry in enumerate(check_list(content["targets"], f"{where}: targets", 1))
    )
    _check_targets(targets, attribute, f"{where}: targets")
    if not several:
        check_strengths(content["sensor"], targets, where)
    sensors = read_sensors(content, where) if several else ()
    if any(target.extent for target in targets) and (several or not extended):
        raise ScenarioError(
            f"{where}: targets with an extent: allowed with the sections sensor and extended"
        )
    given = content["sensor"] if extended and isinstance(content.get("sensor"), Mapping) else {}
    others = (
        "false_alarm_probability",
        "resolution_range_m",
        "blind_speed_mps",
        "range_rate_std_mps",
    )
    for other in others:
        if given.get(other):
            raise ScenarioError(
                f"{where}: sensor: {other} = {given[other]}: allowed is none with the section "
                "extended"
            )
    return Scenario(
        name=name,
        time=read_section(Timing, content["time"], f"{where}: time"),
        sensor=(
            Sensor(
                sensors[0].position_m,
                sensors[0].azimuth_std_deg,
                sensors[0].range_std_m,
                sensors[0].detection_probability,
            )
            if several
            else read_section(Sensor, content["sensor"], f"{where}: sensor")
        ),
        clutter=read_section(Clutter, content["clutter"], f"{where}: clutter"),
        targets=targets,
        tracker=read_section(TrackerKnowledge, content["tracker"], f"{where}: tracker"),
        attribute=attribute,
        sensors=sensors,
        reach=(
            read_section(ReachSection, content["reach"], f"{where}: reach") if several else None
        ),
        extended=(
            read_section(ExtendedKnowledge, content["extended"], f"{where}: extended")
            if extended
            else None
        ),
        notes=notes,
    )


def _read_target(entry: Any, where: str) -> Target:
    if isinstance(entry, Mapping):
        entry = {("class_name" if k == "class" else k): v for k, v in entry.items()}
    turns = entry.get("manoeuvres", []) if isinstance(entry, Mapping) else []
    halts = entry.get("stops", []) if isinstance(entry, Mapping) else []
    manoeuvres = tuple(
        read_section(Manoeuvre, turn, f"{where}: manoeuvres[{index}]")
        for index, turn in enumerate(check_list(turns, f"{where}: manoeuvres", 0))
    )
    extent = entry.get("extent") if isinstance(entry, Mapping) else None
    if extent is not None:
        extent = read_section(Extent, extent, f"{where}: extent")
    stops = tuple(
        read_section(Stop, halt, f"{where}: stops[{index}]")
        for index, halt in enumerate(check_list(halts, f"{where}: stops", 0))
    )
    return read_section(Target, entry, where, manoeuvres=manoeuvres, stops=stops, extent=extent)


def _read_attribute(content: Any, where: str) -> Attribute:
    check_keys(
        content,
        ["classes", "membership", "missed_track_hypotheses", "history_initialisation"],
        ["classes"],
        where,
    )
    classes = tuple(
        read_section(KnownClass, entry, f"{where}: classes[{index}]")
        for index, entry in enumerate(check_list(content["classes"], f"{where}: classes", 2))
    )
    names = [known.name for known in classes]
    if len(set(names)) < len(names):
        raise ScenarioError(f"{where}: classes = {names}: allowed are names that differ")
    membership = read_section(Membership, content.get("membership", {}), f"{where}: membership")
    return read_section(Attribute, content, where, classes=classes, membership=membership)


def _check_targets(targets: tuple[Target, ...], attribute: Attribute, where: str) -> None:
    ids = [target.id for target in targets]
    if len(set(ids)) < len(ids):
        raise ScenarioError(f"{where}: id = {ids}: allowed are ids that differ")
    known = [entry.name for entry in attribute.classes]
    for target in targets:
        if target.class_name not in known:
            raise ScenarioError(
                f"{where}: class = {target.class_name!r}: allowed are the names in "
                f"attribute.classes: {', '.join(known)}"
            )


def _one_line(error: yaml.YAMLError) -> str:
    return " ".join(str(error).split())


class _Loader(yaml.SafeLoader):
    """YAML as people write it: 1e-6 is a number (YAML 1.2), a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [name.value for name, _ in node.value]
        for name in names:
            if names.count(name) > 1 and name != "<<":
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {name!r} is given twice", node.start_mark
                )
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"),
    list("-+0123456789."),
)
