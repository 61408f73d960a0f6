"""Sequential track extraction: Wald's likelihood ratio test, on arrays (Koch 2014, section 4.1).

Is there a target behind a track (h1), or nothing but false detections (h0)? The likelihood ratio
LR = p(Z | h1) / p(Z | h0) of all data since the track began grows with every scan, for a track with
one predicted density by the factor (4.6)

    1 - P_D + sum_j P_D / rho_F  N(z_j; H x, S_j)  l(attributes of j | track) / l(.. | false alarm)

over its detections z_j. LR >= B accepts h1, LR <= A accepts h0, with A and B from the two error
probabilities alone (4.3); no other test with these errors needs fewer scans on average.

After the confirmation the same ratio goes on as a by-product of track maintenance, held at B at
most: else a long life would outweigh any number of misses. It ends the track at A.

Only detections inside the gate are looked at, so that a miss weighs 1 - P_D P_G here: with it the
ratio is that of the data seen, and the errors are kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from gda_tracker.parameters import ParameterError
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.beliefs import AttributeScores
from gda_tracker.vocabulary.hypotheses import Associations, Predictions
from gda_tracker.vocabulary.tracks import CONFIRMED, TENTATIVE


@dataclass(frozen=True, slots=True)
class SequentialTest:
    """Thresholds on the log likelihood ratio: ``log_reject`` log A and ``log_accept`` log B."""

    log_reject: float
    log_accept: float


def sequential_test(
    false_track_probability: float, missed_track_probability: float
) -> SequentialTest:
    """Return the thresholds A = (1 - P_1) / (1 - P_0) and B = P_1 / P_0 (Koch 2014, (4.3)).

    The true errors are bounded by P(accept | h0) <= 1 / B and P(reject | h1) <= A (Wald), and
    smaller than asked for where single scans carry the ratio far beyond a threshold.

    Parameters
    ----------
    false_track_probability
        P_0, the chance that false detections are accepted as a target.
    missed_track_probability
        1 - P_1, the chance that a target's track is rejected.

    Raises
    ------
    ParameterError
        Unless both lie in (0, 1) and their sum is less than 1.

    Examples
    --------
    >>> test = sequential_test(false_track_probability=0.01, missed_track_probability=0.05)
    >>> round(math.exp(test.log_reject), 5), round(math.exp(test.log_accept), 5)
    (0.05051, 95.0)
    """
    p0, missed = false_track_probability, missed_track_probability
    if not (0.0 < p0 < 1.0 and 0.0 < missed < 1.0 and p0 + missed < 1.0):
        raise ParameterError(
            f"parameters false_track_probability = {p0} and missed_track_probability = {missed}: "
            f"allowed are numbers > 0 with a sum < 1"
        )
    return SequentialTest(
        math.log(missed) - math.log1p(-p0),
        math.log1p(-missed) - math.log(p0),
    )


def pair_log_ratios(
    kinematic_log_likelihood: FloatArray,
    clutter_density: FloatArray | float,
    attribute_log_likelihood: FloatArray | float = 0.0,
    clutter_log_likelihood: FloatArray | float = 0.0,
) -> FloatArray:
    """Log ratio (P,) of a pair's likelihoods, from the track and from clutter.

    Parameters
    ----------
    kinematic_log_likelihood
        (P,) log N(z; H x, S) [log 1/(m rad)].
    clutter_density
        rho_F [1/(m rad)], for all pairs or for each; 0 makes the ratio infinite.
    attribute_log_likelihood, clutter_log_likelihood
        (P,) of the pair's attributes, from the track's classes and from a false alarm, in the same
        unit; without attributes both are 0.
    """
    with np.errstate(divide="ignore"):
        log_density = np.log(clutter_density)
    return (
        kinematic_log_likelihood - log_density + attribute_log_likelihood - clutter_log_likelihood
    )


def summed_increments(
    detection_probability: FloatArray,
    gate_probability: float,
    hypothesis: Int32Array | IntArray,
    log_ratio: FloatArray,
) -> FloatArray:
    """What one scan adds to the log ratio of tracks with one predicted density (4.6).

    log(1 - P_D P_G + P_D sum_j ratio_j), whatever detection the state is updated by afterwards.
    The chosen detection alone would not do: where several lie in the gate its own factor is far
    below the sum, and a real target would be rejected.

    Parameters
    ----------
    detection_probability
        (H,) P_D of each hypothesis.
    gate_probability
        P_G.
    hypothesis, log_ratio
        (P,) the gated pairs, in any order, and their log ratios from :func:`pair_log_ratios`.

    Returns
    -------
    (H,) array
    """
    h = len(detection_probability)
    with np.errstate(divide="ignore", invalid="ignore"):
        miss = np.log1p(-detection_probability * gate_probability)
        hits = np.log(detection_probability)[hypothesis] + log_ratio
        peak = miss.copy()
        np.maximum.at(peak, hypothesis, hits)
        # A peak of -inf or +inf is the answer itself.
        shift = np.where(np.isfinite(peak), peak, 0.0)
        total = np.exp(miss - shift) + np.bincount(
            hypothesis, np.exp(hits - shift[hypothesis]), minlength=h
        )
        return np.where(np.isfinite(peak), shift + np.log(total), peak)


def followed_increments(
    detection_probability: FloatArray,
    gate_probability: float,
    hypothesis: Int32Array | IntArray,
    log_ratio: FloatArray,
) -> FloatArray:
    """What one scan adds to the log ratio of branches, each of which follows one detection or none.

    For trees of hypotheses: the sum over a track's branches is its ratio (4.7). Over branches for
    every gated detection and the miss it is that of :func:`summed_increments`.

    Parameters
    ----------
    detection_probability, gate_probability
        As in :func:`summed_increments`, by branch.
    hypothesis, log_ratio
        (K,) the branches that follow a detection, each once, and the log ratio of that pair.

    Returns
    -------
    (H,) array
        log(P_D ratio) with a detection, log(1 - P_D P_G) without.
    """
    with np.errstate(divide="ignore"):
        increments = np.log1p(-detection_probability * gate_probability)
        increments[hypothesis] = np.log(detection_probability[hypothesis]) + log_ratio
    return increments


@dataclass(frozen=True, slots=True)
class GroupMembers:
    """Hypotheses ``rows`` (K,) that share ``detection`` (K,), with the group's log likelihood."""

    rows: IntArray
    detection: IntArray
    log_likelihood: FloatArray


def scan_increments(
    predictions: Predictions,
    scores: AttributeScores | None,
    associations: Associations,
    clutter_density: FloatArray,
    of_three: GroupMembers | None = None,
) -> FloatArray:
    """What an associated scan adds to the log ratio of each hypothesis (H,).

    A detection that was given to another track is that track's: it speaks neither for nor against
    this one. So a second track on a target runs out of detections and ends.

    Parameters
    ----------
    predictions, scores, associations
        Of the same scan. Without scores, or if they were given up, kinematics alone speak.
    clutter_density
        (H,) rho_F around each hypothesis [1/(m rad)].
    of_three
        Members of the chosen groups of three, which the associations do not know.
    """
    decided = associations
    rows, columns = decided.hypothesis, decided.detection
    most = int(columns.max(initial=-1))
    if len(decided.group_chosen):
        # Groups may have detections that are in no gate.
        most = max(most, int(decided.assigned_detection.max(initial=-1)))
    owner = np.full(most + 1, -1, dtype=np.int64)
    served = np.flatnonzero(decided.assigned_detection >= 0)
    owner[decided.assigned_detection[served]] = predictions.track_id[served]
    track = predictions.track_id[rows]
    own = (owner[columns] < 0) | (owner[columns] == track)
    shares = decided.group_chosen
    sharing = np.count_nonzero(shares) > 0
    if sharing:
        shared = np.isin(columns, decided.group_detection[shares])
        own &= ~shared
    if of_three is not None:
        own &= ~np.isin(columns, of_three.detection)
    attribute: FloatArray | float = 0.0
    clutter: FloatArray | float = 0.0
    if scores is not None and not decided.degraded:
        attribute = scores.log_likelihood[own]
        clutter = scores.clutter_log_likelihood[columns[own]]
    rows = rows[own]
    log_ratio = pair_log_ratios(
        decided.kinematic_log_likelihood[own], clutter_density[rows], attribute, clutter
    )
    if sharing:
        # The detection of a group speaks for both members.
        shares = shares & (decided.group_detection >= 0)
        members = np.concatenate([decided.group_first[shares], decided.group_second[shares]])
        likelihood = np.tile(decided.group_log_likelihood[shares], 2)
        rows = np.concatenate([rows, members])
        log_ratio = np.concatenate(
            [log_ratio, pair_log_ratios(likelihood, clutter_density[members])]
        )
    if of_three is not None:
        more = pair_log_ratios(of_three.log_likelihood, clutter_density[of_three.rows])
        rows, log_ratio = np.concatenate([rows, of_three.rows]), np.concatenate([log_ratio, more])
    return summed_increments(
        predictions.detection_probability,
        predictions.settings.gate_probability,
        rows,
        log_ratio,
    )


def track_log_ratios(track_id: IntArray, log_ratio: FloatArray) -> FloatArray:
    """Log ratio (H,) of the track of each hypothesis: the sum over its branches (4.7)."""
    if not len(track_id):
        return np.zeros(0)
    _, track = np.unique(track_id, return_inverse=True)
    peak = np.full(track.max() + 1, -np.inf)
    np.maximum.at(peak, track, log_ratio)
    shift = np.where(np.isfinite(peak), peak, 0.0)
    with np.errstate(divide="ignore", over="ignore"):
        total = np.log(np.bincount(track, np.exp(log_ratio - shift[track])))
    return np.where(np.isfinite(peak), shift + total, peak)[track]


def decide(
    status: IntArray, track_id: IntArray, log_ratio: FloatArray, test: SequentialTest
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Apply the test to the tracks: confirm, hold the ratio, end.

    Parameters
    ----------
    status, track_id, log_ratio
        (H,) of the hypotheses; branches of a track have the same id and status.
    test
        The thresholds.

    Returns
    -------
    status
        (H,) ``CONFIRMED`` where the track was confirmed before or its ratio is at least B.
    log_ratio
        (H,) as before, but where a track's ratio exceeds B all its branches are scaled down so that
        it is B.
    ended
        (H,) whether the track's ratio is at most A.
    """
    total = track_log_ratios(track_id, log_ratio)
    accepted = total >= test.log_accept
    with np.errstate(invalid="ignore"):
        held = np.where(accepted, log_ratio - (total - test.log_accept), log_ratio)
    # A branch of infinite weight has all the weight there is.
    held = np.where(np.isposinf(log_ratio), test.log_accept, held)
    return (
        np.where(accepted | (status == CONFIRMED), CONFIRMED, TENTATIVE).astype(np.int64),
        held,
        total <= test.log_reject,
    )


def held_between(log_ratio: FloatArray, increments: FloatArray, test: SequentialTest) -> FloatArray:
    """Log ratios (N,) after a scan where another rule decides: never beyond the thresholds.

    Else a long life would outweigh any number of misses, and many misses any detection.
    """
    held: FloatArray = np.clip(
        np.minimum(log_ratio, test.log_accept) + increments, test.log_reject, test.log_accept
    )
    return held


def existence_probability(log_ratio: FloatArray, prior: float = 0.5) -> FloatArray:
    """P(h1 | Z) of tracks with these log ratios; Koch's (4.1) with P(h1) = ``prior``.

    The prior of tracks that the tracker starts is :mod:`gda_tracker.tracking.existence`'s.

    Raises
    ------
    ValueError
        Unless ``prior`` lies in (0, 1).
    """
    if not 0.0 < prior < 1.0:
        raise ValueError(f"prior = {prior}: allowed is > 0 and < 1")
    odds: FloatArray = expit(log_ratio + math.log(prior) - math.log1p(-prior))
    return odds
