"""What fields mean, guessed: quantities by their names, units and senses by their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.radar.frames import Fields
from gda_tracker.io.radar.inspection import Inspection
from gda_tracker.io.radar.parameter_groups.fields import ALIASES
from gda_tracker.vocabulary.arrays import FloatArray

# Beyond the names that are taken without asking: names that only hint, for fields of their own.
HINTS: dict[str, tuple[str, ...]] = {
    "range": ("rho", "dist", "distance"),
    "azimuth": ("az", "azi", "azimut", "theta", "angle", "bearing"),
    "elevation": ("el", "elev", "phi"),
    "range_rate": (
        "v",
        "vr",
        "v_r",
        "vel",
        "velocity",
        "speed",
        "radial_velocity",
        "range_rate_mps",
    ),
    "rcs": ("rcs_dbsm", "rcs_db", "rcs_m2", "radar_cross_section"),
}
# Never a radar cross section.
STRENGTHS = ("intensity", "amplitude", "power", "snr", "signal_to_noise_ratio", "noise")
UNITS = {
    "x": "m",
    "y": "m",
    "z": "m",
    "range": "m",
    "range_rate": "m/s",
    "range_std": "m",
    "range_rate_std": "m/s",
    "snr": "dB",
}
ANGLES = ("azimuth", "elevation", "azimuth_std", "elevation_std")
# Radar cross sections that occur, from an insect to a ship [dBsm].
LEAST_DBSM, MOST_DBSM = -60.0, 70.0
# Median difference between an angle and the one of x, y up to which they agree [rad].
SAME_ANGLE = 0.05


@dataclass(slots=True)
class Guesses:
    """What the fields seem to mean.

    ``quantities`` names the field of each quantity, ``units`` the unit of each field;
    ``parameters`` are those of the radar input that follow; ``remarks`` are lines for the report,
    ``rcs`` the one about the radar cross section. ``rcs_usable`` is whether it can be one.
    """

    quantities: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, object] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    rcs: str = "none: there is no such field"
    rcs_usable: bool = False

    def meaning(self, name: str) -> str:
        """Return what a field seems to be, or nothing."""
        quantity = next((q for q, field_name in self.quantities.items() if field_name == name), "")
        if quantity:
            return quantity.replace("_", " ").replace(" std", ", standard deviation")
        return "signal strength, no radar cross section" if name.lower() in STRENGTHS else ""


def guess(inspection: Inspection, field_names: Mapping[str, str] | None = None) -> Guesses:
    """Guess what the fields of a topic or file mean.

    Parameters
    ----------
    inspection
        What was seen.
    field_names
        Field of a quantity where that is known, e.g. from a preset.
    """
    found = Guesses()
    _name(inspection, found, field_names or {})
    values = {q: inspection.values.get(name, np.zeros(0)) for q, name in found.quantities.items()}
    for quantity, name in found.quantities.items():
        if quantity in UNITS:
            found.units[name] = UNITS[quantity]
    _angles(values, found)
    if {"x", "y", "range"} <= set(values):
        _compare_ranges(values, found)
    _rcs(inspection, values, found)
    return found


def _name(inspection: Inspection, found: Guesses, field_names: Mapping[str, str]) -> None:
    """Name the fields of the quantities: told, taken by every driver's name, or hinted at."""
    present = [item.name for item in inspection.statistics]
    hinted = []
    for quantity, usual in ALIASES.items():
        told = field_names.get(quantity)
        name = told if told in present else next((n for n in usual if n in present), None)
        if name is None:
            name = next((n for n in present if n.lower() in HINTS.get(quantity, ())), None)
            if name is None or name in found.quantities.values():
                continue
        if name not in usual:
            hinted.append(f"{quantity}={name}")
        found.quantities[quantity] = name
    if hinted:
        found.parameters["field_names"] = hinted


def _angles(values: Fields, found: Guesses) -> None:
    """Unit of the angles, and the sense of the azimuth if there are x and y to compare it with."""
    names = [q for q in ANGLES if q in values]
    if not names:
        return
    largest = max((float(np.nanmax(np.abs(values[q]), initial=0.0)) for q in names), default=0.0)
    unit = "deg" if largest > 2.0 * np.pi + 0.01 else "rad"
    if {"x", "y", "azimuth"} <= set(values):
        compared = _sense(values)
        if compared is not None:
            unit, sign, zero, error = compared
            text = "counter-clockwise" if sign > 0 else "clockwise"
            axis = {0: "x", 90: "y", 180: "-x", -90: "-y"}[zero]
            found.remarks.append(
                f"azimuth agrees with x and y as {unit}, {text} from {axis} (median difference "
                f"{np.rad2deg(error):.1g} deg)"
            )
            found.parameters |= {"azimuth_sign": sign, "azimuth_zero_deg": float(zero)}
        else:
            found.remarks.append(
                "azimuth does not agree with x and y in any unit or sense: position_source: "
                "cartesian leaves it out"
            )
            found.parameters["position_source"] = "cartesian"
    found.parameters["angle_unit"] = unit
    for quantity in names:
        found.units[found.quantities[quantity]] = unit


def _sense(values: Fields) -> tuple[str, int, int, float] | None:
    """Unit, sign and zero [deg] that make the azimuth that of x and y, and the median error."""
    x, y, azimuth = values["x"], values["y"], values["azimuth"]
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(azimuth) & (np.hypot(x, y) > 0.1)
    if np.count_nonzero(good) < 3:
        return None
    expected = np.arctan2(y[good], x[good])
    best = None
    for unit, scale in (("rad", 1.0), ("deg", np.deg2rad(1.0))):
        for sign in (1, -1):
            for zero in (0, 90, -90, 180):
                angle = np.deg2rad(zero) + sign * scale * azimuth[good]
                turn = np.angle(np.exp(1j * (angle - expected)))
                error = float(np.median(np.abs(turn)))
                if best is None or error < best[3]:
                    best = (unit, sign, zero, error)
    return best if best is not None and best[3] < SAME_ANGLE else None


def _compare_ranges(values: Fields, found: Guesses) -> None:
    x, y, z = values["x"], values["y"], values.get("z", np.zeros(len(values["x"])))
    with np.errstate(invalid="ignore"):
        difference = np.abs(values["range"] - np.sqrt(x**2 + y**2 + z**2))
    difference = difference[np.isfinite(difference)]
    if not len(difference):
        return
    median, largest = float(np.median(difference)), float(difference.max())
    if median > 1.0:
        found.remarks.append(
            f"range differs from that of x, y, z by {median:.2g} m (median): another unit, or x, "
            "y, z from another origin"
        )
    elif largest > 0.01:
        found.remarks.append(f"range differs from that of x, y, z by up to {largest:.2g} m")


# --- radar cross section --------------------------------------------------------------------------


def _rcs(inspection: Inspection, values: Fields, found: Guesses) -> None:
    if "rcs" not in values:
        return
    name = found.quantities["rcs"]
    statistics = inspection.of(name)
    declared = statistics.type if statistics else ""
    finite = values["rcs"][np.isfinite(values["rcs"])]
    as_float = _as_float(inspection, name) if declared.startswith(("uint8", "int8")) else None
    if as_float is not None and not _signed_byte(declared, finite):
        found.parameters["field_types"] = [f"{name}=float32"]
        found.remarks.append(
            f"{name} is declared {declared}, but holds float32: field_types: [{name}=float32]"
        )
        finite = as_float
    found.rcs, usable, parameters = judge_rcs(finite)
    found.rcs_usable = usable
    found.parameters |= parameters
    if usable:
        found.units[name] = {"dbsm": "dBsm", "m2": "m2"}[str(parameters["rcs_unit"])]


def judge_rcs(values: FloatArray) -> tuple[str, bool, dict[str, object]]:
    """Say whether values (n,), finite, can be radar cross sections, and in which unit.

    Returns
    -------
    text, usable, parameters
        A line for the report; whether they can be used; parameters of the radar input.
    """
    none: dict[str, object] = {"rcs_unit": "none"}
    if not len(values):
        return "no value is known", False, none
    least, most = float(values.min()), float(values.max())
    if not values.any():
        return "all values are 0: the driver does not fill the field", False, none
    if least == most and len(values) >= 10:
        return f"all values are {least:g}: a constant is no radar cross section", False, none
    median = float(np.median(values))
    whole = bool(np.all(values == np.round(values)))
    if least >= 0.0 and most <= 255.0 and whole and 88.0 <= median <= 168.0:
        text = f"{least:g} to {most:g}, whole numbers around 128: dBsm + 128, taken off"
        return text, True, {"rcs_unit": "dbsm", "rcs_offset": -128.0}
    if least < 0.0:
        if least < LEAST_DBSM or most > MOST_DBSM:
            text = f"{least:g} to {most:g}: outside {LEAST_DBSM:g} to {MOST_DBSM:g} dBsm"
            return f"{text}, look at the driver's manual", False, none
        return (
            f"plausible in dBsm: {least:g} to {most:g}, median {median:g}",
            True,
            {"rcs_unit": "dbsm"},
        )
    if most > 10.0 * MOST_DBSM:
        text = f"{least:g} to {most:g}, never negative: plausible in m2"
        return text, True, {"rcs_unit": "m2"}
    text = f"{least:g} to {most:g}, never negative: m2, or dBsm of large objects only"
    return f"{text}; declare rcs_unit to use it", False, none


def _signed_byte(declared: str, values: FloatArray) -> bool:
    """Whether the bytes as they are declared look like decibels: signed, most of them small."""
    return declared.startswith("int8") and bool(np.mean(np.abs(values) <= MOST_DBSM) > 0.95)


def _as_float(inspection: Inspection, name: str) -> FloatArray | None:
    """Return a byte field read as float32, if that gives radar cross sections throughout."""
    found = []
    for frame in inspection.examples:
        try:
            found.append(frame.read([name], {name: "float32"})[name])
        except UserError:
            return None  # not a point cloud, or no room for four bytes
    values = np.concatenate(found) if found else np.zeros(0)
    if not len(values) or not np.isfinite(values).all():
        return None
    # Bytes of other fields read as a float are tiny or huge.
    plausible = (np.abs(values) > 1e-3) & (values >= LEAST_DBSM) & (values <= MOST_DBSM)
    return values if np.mean(plausible) > 0.9 and len(np.unique(values)) > 1 else None
