"""Kinds of sensors: what each measures, and in which unit.

The quantities are defined in :mod:`gda_tracker.kinematics.measurement_models`.
"""

from __future__ import annotations

from dataclasses import dataclass

RANGE, AZIMUTH, RANGE_RATE = "range", "azimuth", "range_rate"
RANGE_AZIMUTH = "range_azimuth"


@dataclass(frozen=True)
class MeasurementModel:
    """What a sensor measures.

    ``quantities`` in the order range, azimuth, range rate; ``reference_sign`` is the sign of the
    reference's range and range rate in the sum, 0 without a reference; ``rotated``: the range rate
    is linearised in axes turned to the measured azimuth.
    """

    name: str
    quantities: tuple[str, ...]
    reference_sign: float = 0.0
    rotated: bool = False

    def __len__(self) -> int:
        return len(self.quantities)

    @property
    def unit(self) -> str:
        """Unit of the measurement space."""
        units = {RANGE: "m", AZIMUTH: "rad", RANGE_RATE: "m/s"}
        return " ".join(units[quantity] for quantity in self.quantities)

    @property
    def has_reference(self) -> bool:
        """Whether there is a transmitter or a second receiver."""
        return self.reference_sign != 0.0

    @property
    def locates(self) -> bool:
        """Whether one measurement gives a position."""
        return RANGE in self.quantities and AZIMUTH in self.quantities

    @property
    def starts(self) -> bool:
        """Whether one measurement bounds the position: a point, a ray or a curve."""
        return RANGE in self.quantities or AZIMUTH in self.quantities


MEASUREMENT_MODELS = {
    model.name: model
    for model in (
        MeasurementModel("bearing", (AZIMUTH,)),
        MeasurementModel("range", (RANGE,)),
        MeasurementModel("range_doppler", (RANGE, RANGE_RATE)),
        MeasurementModel("doppler", (RANGE, AZIMUTH, RANGE_RATE)),
        MeasurementModel("doppler_rotated", (RANGE, AZIMUTH, RANGE_RATE), rotated=True),
        MeasurementModel("bistatic", (RANGE,), 1.0),
        MeasurementModel("bistatic_doppler", (RANGE, RANGE_RATE), 1.0),
        MeasurementModel("tdoa", (RANGE,), -1.0),
        MeasurementModel("fdoa", (RANGE_RATE,), -1.0),
        MeasurementModel("tdoa_fdoa", (RANGE, RANGE_RATE), -1.0),
    )
}
# range_azimuth is the sensor of gda_tracker.kinematics.sensor_models.
SENSOR_MODELS = (RANGE_AZIMUTH, *MEASUREMENT_MODELS)
