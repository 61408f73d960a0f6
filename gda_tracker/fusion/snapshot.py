"""The tracks of all radars at one time: what association and fusion look at."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.vocabulary.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Snapshot:
    """M tracks of r radars at the common time in the common frame, the first radar's first.

    Attributes
    ----------
    radar : (M,)
        Rising.
    track_id : (M,)
        Rising within a radar.
    mean : (M, 4), covariance : (M, 4, 4)
        As the radar sees them, with its bias.
    likelihood : (M, C)
        Of the common classes.
    existence : (M,)
        NaN: not known.
    company : (M,)
        Fused track that the track belonged to until now, -1 for none.
    """

    radar: IntArray
    track_id: IntArray
    mean: FloatArray
    covariance: FloatArray
    likelihood: FloatArray
    existence: FloatArray
    company: IntArray

    def __len__(self) -> int:
        return len(self.radar)
