"""Which preset fits what a radar publishes: the fields of known drivers, and which agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.io.radar.file_kinds import ARS548, ASTERIX, MMWAVE, SRR520
from gda_tracker.io.radar.frames import RadarFrame
from gda_tracker.io.radar.messages import POINT_CLOUD, RADAR_SCAN, RADAR_TRACKS

# Least share of the fields of message and signature together that both have.
LEAST_FIT = 0.6


@dataclass(frozen=True, slots=True)
class Signature:
    """What a driver publishes, as far as it tells the radar.

    ``required`` fields with their declared types must all be there, of ``usual`` ones some may
    lack. ``zero`` names a field that this driver always leaves 0.
    """

    preset: str
    kind: str
    required: tuple[str, ...]
    types: dict[str, str]
    zero: str = ""


@dataclass(frozen=True, slots=True)
class Fit:
    """How well a preset fits: ``share`` of the fields that agree, 0 if it does not, and why."""

    preset: str
    share: float
    reason: str


def _fields(text: str) -> dict[str, str]:
    """Return declared types by field of ``float32 x y z; uint8 rcs``."""
    found = {}
    for group in text.split(";"):
        kind, *names = group.split()
        found.update(dict.fromkeys(names, kind))
    return found


def _cloud(preset: str, required: str, fields: str) -> Signature:
    return Signature(preset, POINT_CLOUD, tuple(required.split()), _fields(fields))


RETURNS = _fields("number range azimuth elevation doppler_velocity amplitude")
TRACKS = _fields("number x y z range_rate length width height classification range_std azimuth_std")
SIGNATURES = (
    _cloud(
        "continental_ars548",
        "range azimuth range_rate rcs range_rate_std",
        "float32 x y z azimuth azimuth_std elevation elevation_std range range_std range_rate "
        "range_rate_std; int8 rcs; uint16 measurement_id object_id; "
        "uint8 positive_predictive_value classification multi_target_probability ambiguity_flag",
    ),
    _cloud(
        "continental_srr520",
        "range azimuth range_rate rcs snr pdh00",
        "float32 x y z range azimuth range_rate snr; uint8 rcs pdh00 pdh01 pdh02 pdh03 pdh04 pdh05",
    ),
    _cloud(
        "smartmicro_umrr",
        "radial_speed power rcs noise snr azimuth_angle range",
        "float32 x y z radial_speed power rcs noise snr azimuth_angle elevation_angle range",
    ),
    _cloud("altos", "x y z h s v", "float32 x y z h s v"),
    _cloud(
        "provizio",
        "x y z radar_relative_radial_velocity signal_to_noise_ratio",
        "float32 x y z radar_relative_radial_velocity signal_to_noise_ratio "
        "ground_relative_radial_velocity",
    ),
    _cloud("ti_mmwave", "x y intensity range doppler", "float32 x y z intensity range doppler"),
    _cloud(
        "carla",
        "x y z Range Velocity AzimuthAngle",
        "float32 x y z Range Velocity AzimuthAngle ElevationAngle",
    ),
    _cloud(
        "mmwave_walk",
        "x y range azimuth doppler power",
        "float32 x y z range azimuth elevation doppler power power_value",
    ),
    Signature("continental_ars408", RADAR_SCAN, tuple(RETURNS), RETURNS, zero="amplitude"),
    Signature("radar_scan", RADAR_SCAN, tuple(RETURNS), RETURNS),
    Signature("radar_tracks", RADAR_TRACKS, ("x", "y", "range_rate"), TRACKS),
)


# Files, which say themselves what they are.
OF_FILES = {
    ARS548: "continental_ars548",
    SRR520: "continental_srr520",
    MMWAVE: "mmwave_walk",
    ASTERIX: "asterix_cat048",
}


def presets_of(kind: str) -> list[str]:
    """Return the presets for a kind of message."""
    return [signature.preset for signature in SIGNATURES if signature.kind == kind]


def fits(frames: Sequence[RadarFrame]) -> list[Fit]:
    """Return how well each preset fits some frames of one topic, the best first.

    Those for other kinds of message are left out.
    """
    frames = [frame for frame in frames if frame.types]
    if not frames:
        return []
    if frames[0].kind in OF_FILES:
        return [Fit(OF_FILES[frames[0].kind], 1.0, "by the kind of file")]
    found = [
        _fit(signature, frames) for signature in SIGNATURES if signature.kind == frames[0].kind
    ]
    return sorted(found, key=lambda fit: -fit.share)  # stable: the more special one stands first


def best_preset(frames: Sequence[RadarFrame]) -> str | None:
    """Return the name of the preset that fits best, ``None`` if none does."""
    found = fits(frames)
    return found[0].preset if found and found[0].share > 0.0 else None


def _fit(signature: Signature, frames: Sequence[RadarFrame]) -> Fit:
    present = frames[0].types
    missing = [name for name in signature.required if name not in present]
    if missing:
        return Fit(signature.preset, 0.0, f"no field {', '.join(missing)}")
    common = [name for name in signature.types if name in present]
    other = [name for name in common if present[name] != signature.types[name]]
    agree = len(common) - 0.5 * len(other)
    share = agree / len(set(present) | set(signature.types))
    if share < LEAST_FIT:
        strange = [name for name in present if name not in signature.types]
        return Fit(signature.preset, 0.0, f"other fields too: {', '.join(strange)}")
    if signature.zero and not _all_zero(frames, signature.zero):
        return Fit(signature.preset, 0.0, f"{signature.zero} is not always 0")
    reason = f"{len(common)} of {len(present)} fields by name"
    if other:
        reason += "".join(
            f", {name} is {present[name]}, not {signature.types[name]}" for name in other
        )
    else:
        reason += " and type"
    if signature.zero:
        reason += f", {signature.zero} always 0"
    return Fit(signature.preset, share, reason)


def _all_zero(frames: Sequence[RadarFrame], name: str) -> bool:
    """Whether a field is 0 throughout, and is there at all."""
    try:
        values = np.concatenate([frame.read([name], {})[name] for frame in frames])
    except UserError:
        return False
    return bool(len(values)) and not values.any()
