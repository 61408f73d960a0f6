"""How probably there is a target behind a track.

The odds of a target against false alarms are a product of three factors:

- the *prior odds*: its two first detections are a new target's, or two false alarms;
- the likelihood ratio of all that came after them, under every rule of extraction, held between
  the thresholds of the sequential test (Koch 2014, (4.1), (4.6); :mod:`.extraction`);
- under ``mht`` the *room* that the other tracks leave a tentative one, whose detections
  may be theirs.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from gda_tracker.association.global_hypotheses import LOG_VANISHING
from gda_tracker.kinematics.sensor_models import polar_measurements
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.initiation import NewTracks
from gda_tracker.tracking.measurement_clutter import log_ratio_of_starts
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, IntArray
from gda_tracker.vocabulary.scans import Scan


def existence_of_tracks(table: HypothesisTable) -> FloatArray:
    """Probability (H,) of a target behind the track of each row."""
    odds = table.log_prior_odds + table.log_likelihood_ratio + table.log_room
    probability: FloatArray = expit(odds)
    return probability


def prior_odds(
    new: NewTracks, scan: Scan, clutter_density: float, parameters: TrackManagerParameters
) -> FloatArray:
    """Log odds of new tracks (N,): a new target against two false alarms.

    With rho new targets per false alarm, the first detection counts rho, each scan without one
    1 - P_D, the second one P_D p(z) / beta, with p(z) the density of the second position given the
    first (``NewTracks.log_density``), times the range as beta is per m and rad. A track that starts
    from one detection of a sensor with a model of its own has rho alone, over the scan's
    ``relative_clutter_density`` there.

    Parameters
    ----------
    new
        What starts on the scan.
    scan
        Has the second detections.
    clutter_density
        beta [1/(m rad)].
    parameters
        Of the track manager; ``mht_new_target_ratio`` is rho.
    """
    p = parameters
    if scan.sensor_model:
        # A Gaussian sum starts from one detection.
        return log_ratio_of_starts(new, scan, p.mht_new_target_ratio)
    range_m = polar_measurements(scan).range_m[new.detection]
    with np.errstate(divide="ignore"):
        log_clutter, log_missed, log_detected, log_range = (
            np.maximum(np.log(value), LOG_VANISHING)
            for value in (
                clutter_density,
                1.0 - p.detection_probability,
                p.detection_probability,
                range_m,
            )
        )
    odds: FloatArray = (
        np.log(p.mht_new_target_ratio)
        + (new.gap_scans - 1) * log_missed
        + log_detected
        + log_range
        + new.log_density
        - log_clutter
    )
    return odds


def log_room(
    log_score: FloatArray, track: IntArray, optional: IntArray, absent: FloatArray
) -> FloatArray:
    """How much room the other tracks leave each optional one, in logarithms, 0 at most.

    A track on its own would be in the global hypothesis at the odds w, the sum of the weights of
    its leaves, to one. Among others it is there at (1 - absent) : absent. What is missing is the
    share of the weight of the others' hypotheses in which its detections are left to it, on
    average over its leaves.

    Parameters
    ----------
    log_score, track
        (L,) of all leaves, by rising rank of the track.
    optional
        (O,) ranks of the tracks that may be absent.
    absent
        (O,) probability that they are.

    Returns
    -------
    (O,) array
        log[(1 - absent) / (absent w)]; 0 where absence is too improbable to be told.
    """
    begins = np.searchsorted(track, np.arange(track[-1] + 1 if len(track) else 0))
    top = np.maximum.reduceat(log_score, begins)
    reference = np.where(top > -np.inf, top, 0.0)
    weight = np.add.reduceat(np.exp(log_score - reference[track]), begins)
    with np.errstate(divide="ignore"):
        alone = (reference + np.log(weight))[optional]
        # A sum of probabilities may exceed one by rounding.
        odds = np.log1p(-np.minimum(absent, 1.0)) - np.log(absent)
    # A track without any weight has no use of room.
    return np.minimum(odds - np.where(alone > -np.inf, alone, 0.0), 0.0)
