"""Parameters of radar_input: what the fields mean: names, units, signs, radar cross section."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gda_tracker.io.radar.point_cloud import TYPE_NAMES
from gda_tracker.parameters import ParameterError, parameter

ANGLE_UNITS = ("rad", "deg")
RCS_UNITS = ("none", "dbsm", "m2")
# Names under which drivers publish a quantity, in the order in which they are looked for. A signal
# strength is never taken for a radar cross section.
ALIASES: dict[str, tuple[str, ...]] = {
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
    "range": ("range", "Range", "r"),
    "azimuth": ("azimuth", "azimuth_angle", "AzimuthAngle"),
    "elevation": ("elevation", "elevation_angle", "ElevationAngle"),
    "range_rate": (
        "range_rate",
        "radial_speed",
        "doppler_velocity",
        "doppler",
        "Velocity",
        "radar_relative_radial_velocity",
    ),
    "rcs": ("rcs",),
    "range_std": ("range_std",),
    "azimuth_std": ("azimuth_std",),
    "elevation_std": ("elevation_std",),
    "range_rate_std": ("range_rate_std",),
    "snr": ("snr", "signal_to_noise_ratio"),
    # Time of each point after the stamp of the scan.
    "time_offset": ("time_offset",),
}
QUANTITIES = tuple(ALIASES)


@dataclass(frozen=True)
class FieldParameters:
    """What the fields of a radar mean."""

    position_source: str = parameter(
        "auto",
        "polar: from range and azimuth; cartesian: from x, y and z; auto: polar where there is "
        "range and azimuth",
        choices=("auto", "polar", "cartesian"),
    )
    field_names: list[str] = parameter(
        [],
        "fields that go by other names than the usual ones, as quantity=field, e.g. rcs=s; "
        f"quantity= for one that is not to be used. Quantities: {', '.join(QUANTITIES)}",
    )
    field_types: list[str] = parameter(
        [],
        "types in place of those a driver declares, as field=type, e.g. rcs=float32; one of "
        f"{', '.join(TYPE_NAMES)}",
        advanced=True,
    )
    angle_unit: str = parameter("rad", "unit of azimuth and elevation", choices=ANGLE_UNITS)
    azimuth_sign: int = parameter(
        1,
        "1: azimuth counts counter-clockwise seen from above, -1: clockwise",
        minimum=-1,
        maximum=1,
    )
    azimuth_zero_deg: float = parameter(
        0.0,
        "direction of azimuth 0 in the sensor's frame, counter-clockwise from its x axis: 90 if it "
        "is the y axis",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    cartesian_yaw_deg: float = parameter(
        0.0,
        "turn that brings the published x and y to x ahead and y left: 90 where y is ahead and x "
        "right",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    elevation_used: bool = parameter(
        True, "pass the elevation on; without it the radar is taken for one in the plane"
    )
    range_rate_sign: int = parameter(
        1,
        "1: a positive range rate goes away from the radar, -1: comes closer",
        minimum=-1,
        maximum=1,
    )
    range_rate_used: bool = parameter(True, "pass the range rate on")
    rcs_unit: str = parameter(
        "none",
        "what the field rcs holds after scale and offset: dbsm (dB relative to 1 m2), m2, or none: "
        "it is not used",
        choices=RCS_UNITS,
    )
    rcs_scale: float = parameter(1.0, "the field is multiplied by it", advanced=True)
    rcs_offset: float = parameter(0.0, "then this is added", advanced=True)
    rcs_minimum: float = parameter(
        -1e6, "smaller values count as unknown, in the unit of rcs_unit", advanced=True
    )
    rcs_maximum: float = parameter(
        1e6, "larger values count as unknown, in the unit of rcs_unit", advanced=True
    )
    attribute_fields: list[str] = parameter(
        [],
        "fields that detections bring as further attributes, as name=field, e.g. snr_db=snr; what "
        "they say of a class is declared in rcs_fuzzifier",
    )

    def check(self) -> None:
        """Refuse what does not fit together."""
        for name in ("azimuth_sign", "range_rate_sign"):
            if getattr(self, name) not in (-1, 1):
                raise ParameterError(
                    f"parameter {name} = {getattr(self, name)}: allowed is 1 or -1"
                )
        if not self.rcs_minimum < self.rcs_maximum:
            raise ParameterError(
                f"parameter rcs_maximum = {self.rcs_maximum}: allowed is a number > rcs_minimum = "
                f"{self.rcs_minimum}"
            )
        if not math.isfinite(self.rcs_scale) or self.rcs_scale == 0.0:
            raise ParameterError(
                f"parameter rcs_scale = {self.rcs_scale}: allowed is a number other than 0"
            )
        names = _pairs("field_names", self.field_names)
        for quantity in names:
            if quantity not in ALIASES:
                raise ParameterError(
                    f"parameter field_names: quantity {quantity!r}, allowed is one of "
                    f"{', '.join(QUANTITIES)}"
                )
        for field, kind in _pairs("field_types", self.field_types).items():
            if kind not in TYPE_NAMES:
                raise ParameterError(
                    f"parameter field_types: {field}={kind}, allowed is one of "
                    f"{', '.join(TYPE_NAMES)}"
                )
        if "" in _pairs("attribute_fields", self.attribute_fields).values():
            raise ParameterError(
                f"parameter attribute_fields = {self.attribute_fields}: allowed are name=field"
            )

    @property
    def type_overrides(self) -> dict[str, str]:
        """Types in place of the declared ones, by field."""
        return _pairs("field_types", self.field_types)

    @property
    def attributes(self) -> dict[str, str]:
        """Fields of the further attributes, by name."""
        return _pairs("attribute_fields", self.attribute_fields)

    def fields_of(self, present: list[str]) -> dict[str, str]:
        """Return the field of each quantity, of those that are ``present`` in the input.

        Raises
        ------
        ParameterError
            If ``field_names`` names a field that is not there.
        """
        named = _pairs("field_names", self.field_names)
        found = {}
        for quantity, usual in ALIASES.items():
            if quantity in named:
                if not named[quantity]:
                    continue
                if named[quantity] not in present:
                    raise ParameterError(
                        f"parameter field_names: {quantity}={named[quantity]}, but the fields are "
                        f"{', '.join(present)}"
                    )
                found[quantity] = named[quantity]
                continue
            match = next((name for name in usual if name in present), None)
            if match is not None:
                found[quantity] = match
        if self.rcs_unit == "none":
            found.pop("rcs", None)
        return found


def _pairs(parameter_name: str, entries: list[str]) -> dict[str, str]:
    """Return ``a=b`` entries as a mapping."""
    found: dict[str, str] = {}
    for entry in entries:
        name, sign, value = entry.partition("=")
        if not sign or not name.strip() or name.strip() in found:
            raise ParameterError(
                f"parameter {parameter_name}: {entry!r}, allowed are entries name=value that differ"
            )
        found[name.strip()] = value.strip()
    return found
