"""Lanes and plans in the filter: two more motion models of the interacting ones.

Each hypothesis has the models of the filter (one with ``cv``), then ``lane_keeping`` if there are
lanes, then ``plan_keeping`` if there are plans. The weight of such a model is the belief that the
target keeps to a lane, or carries out its plan; no target is forced to. Between a free target and
a keeper there is a Markov chain in continuous time whose stationary share of keepers is
``lane_keeping_share`` in the middle of a lane, and whose mean stay is ``lane_keeping_s``. The
chance to begin falls with the distance from lane or plan like a Gaussian; what begins is updated
by it, once (:meth:`LaneCourse.entered`, :meth:`Ahead.entered`). Where there is no lane, past its
end, and after the last waypoint, keepers become free.

What a hypothesis that stays free learns from not having begun is left out: its state stays as it
is, its weight falls.
"""

from __future__ import annotations

import math

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.lane_motion import Entries
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.kinematics.model_sets import CONSTANT_VELOCITY, HEAD, ModelSet
from gda_tracker.kinematics.motion_models import CV
from gda_tracker.kinematics.plan_motion import PlanCourse
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.parameter_groups.context import LANE_KEEPING
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray


def base_models(parameters: TrackManagerParameters) -> ModelSet:
    """The motion models of free targets."""
    if parameters.filter != CV:
        return parameters.model_set
    p = parameters
    return ModelSet((CONSTANT_VELOCITY,), (p.process_noise_std_mps2,), 1.0, 1.0, 1.0, 1.0)


def with_keepers(
    table: HypothesisTable,
    shares: FloatArray,
    stamp_ns: int | None,
    parameters: TrackManagerParameters,
) -> HypothesisTable:
    """Return hypotheses that have the models of free targets and of keepers.

    Those of other models start anew from their moments: keepers have the stationary share, as far
    as the state is one of theirs.

    Parameters
    ----------
    table
        H hypotheses.
    shares
        (M,) of the free models in the long run.
    stamp_ns
        Time of the states; ``None``: not known, nobody has taken up a plan.
    parameters
        Of the track manager.
    """
    models, courses, h = base_models(parameters), parameters.courses, len(table)
    names = (*models.names, *courses.names)
    if table.models == names and table.model_weight.shape[1] == len(names):
        return table
    mean, covariance = models.extended(table.mean, table.covariance)
    begun = table.copy()
    begun.models = names
    begun.model_mean = np.repeat(mean[:, None], len(names), axis=1)
    begun.model_covariance = np.repeat(covariance[:, None], len(names), axis=1)
    begun.model_weight = np.zeros((h, len(names)))
    if not h:
        return begun
    share = _shares(parameters, courses.names)
    for number, name in enumerate(courses.names):
        entry = _entries(name, table.mean, table.covariance, table.track_id, stamp_ns, parameters)
        place = len(models) + number
        begun.model_weight[:, place] = share[number] * entry.probability
        begun.model_mean[:, place], begun.model_covariance[:, place] = models.extended(
            entry.mean, entry.covariance
        )
    kept = begun.model_weight.sum(axis=1, keepdims=True)
    # Both at once may be more than all.
    begun.model_weight /= np.maximum(kept, 1.0)
    begun.model_weight[:, : len(models)] = np.maximum(1.0 - kept, 0.0) * shares
    return begun


def predict_keepers(
    table: HypothesisTable,
    switching: FloatArray,
    shares: FloatArray,
    dt_s: float,
    stamp_ns: int,
    parameters: TrackManagerParameters,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mixtures of hypotheses ``dt_s`` [s] > 0 later.

    Parameters
    ----------
    table
        H > 0 hypotheses as of :func:`with_keepers`.
    switching
        (M, M) or (H, M, M) between free models, entry [j, i] to j from i.
    shares
        (M,) of the free models in the long run: what keepers become that are free.
    dt_s
        Time step.
    stamp_ns
        Time predicted to.
    parameters
        Of the track manager.

    Returns
    -------
    weight, mean, covariance
        (H, M + K), (H, M + K, s), (H, M + K, s, s) with K the models of keepers.
    """
    models, courses = base_models(parameters), parameters.courses
    names, h, m = courses.names, len(table), len(models)
    before_ns = stamp_ns - round(dt_s * 1e9)
    weight, mean, covariance = table.model_weight, table.model_mean, table.model_covariance
    # Each free model of each hypothesis asks whether it begins to keep.
    asked = (
        mean[:, :m, :HEAD].reshape(-1, HEAD),
        covariance[:, :m, :HEAD, :HEAD].reshape(-1, HEAD, HEAD),
        np.repeat(table.track_id, m) if len(table.track_id) == h else np.zeros(0, np.int64),
    )
    begin, leave = _chances(dt_s, parameters, names)
    entries = [_entries(name, *asked, before_ns, parameters) for name in names]
    entering = np.stack([e.probability.reshape(h, m) for e in entries], axis=1)
    entering = entering * begin[:, None]
    entering /= np.maximum(entering.sum(axis=1, keepdims=True), 1.0)
    leaving = np.tile(leave, (h, 1))
    for number, name in enumerate(names):
        gone = _without_course(name, table, m + number, before_ns, parameters)
        leaving[gone, number] = 1.0
    full = np.zeros((h, m + len(names), m + len(names)))
    full[:, :m, :m] = switching * (1.0 - entering.sum(axis=1))[:, None, :]
    full[:, m:, :m] = entering
    full[:, :m, m:] = shares[:, None] * leaving[:, None, :]
    each = np.arange(m, m + len(names))
    full[:, each, each] = 1.0 - leaving
    mixed, mixed_mean, mixed_covariance = imm.mix(weight, mean, covariance, full)
    for number, entry in enumerate(entries):
        _keepers((mixed_mean, mixed_covariance), table, full, m + number, entry, models)
    free, free_covariance = mixed_mean[:, :m], mixed_covariance[:, :m]
    transition, noise = models.matrices(dt_s)
    moved, spread = imm.predict(free, free_covariance, transition, noise)
    if models.turns:
        moved, transition = models.moved(free, dt_s)
        _, spread = imm.predict(free, free_covariance, transition, noise)
    mixed_mean[:, :m], mixed_covariance[:, :m] = moved, spread
    for number, name in enumerate(names):
        place = m + number
        after, widened = _moved(
            name,
            mixed_mean[:, place, :HEAD],
            mixed_covariance[:, place, :HEAD, :HEAD],
            table.track_id,
            (before_ns, stamp_ns),
            parameters,
        )
        # A keeper knows no acceleration and no turn rate.
        mixed_mean[:, place], mixed_covariance[:, place] = models.extended(after, widened)
    return mixed, mixed_mean, mixed_covariance


def _shares(parameters: TrackManagerParameters, names: tuple[str, ...]) -> FloatArray:
    """Share of keepers (K,) in the middle of lane or plan."""
    p = parameters
    return np.array(
        [p.lane_keeping_share if n == LANE_KEEPING else p.plan_keeping_share for n in names]
    )


def _chances(
    dt_s: float, parameters: TrackManagerParameters, names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    """Chances (K,) to begin, in the middle, and to leave within ``dt_s``."""
    p, share = parameters, _shares(parameters, names)
    stay = np.array([p.lane_keeping_s if n == LANE_KEEPING else p.plan_keeping_s for n in names])
    # Rates r_out = 1 / stay and r_in = r_out share / (1 - share): their sum is the chain's rate.
    settled = np.array([-math.expm1(-dt_s / one) for one in stay * (1.0 - share)])
    return share * settled, (1.0 - share) * settled


def _entries(
    name: str,
    mean: FloatArray,
    covariance: FloatArray,
    track_id: IntArray,
    stamp_ns: int | None,
    parameters: TrackManagerParameters,
) -> Entries:
    """What begins of states (N, 4), (N, 4, 4)."""
    courses = parameters.courses
    if name == LANE_KEEPING:
        assert courses.lanes is not None
        return courses.lanes.entered(mean, covariance, courses.lanes.piece_of(mean, covariance))
    probability, after, spread = np.zeros(len(mean)), mean.copy(), covariance.copy()
    for rows, plan in _of_plans(track_id, courses.plans):
        if stamp_ns is None or stamp_ns >= plan.end_ns:
            continue
        entry = plan.ahead(stamp_ns).entered(mean[rows], covariance[rows])
        probability[rows], after[rows] = entry.probability, entry.mean
        spread[rows] = entry.covariance
    return Entries(probability, after, spread)


def _without_course(
    name: str,
    table: HypothesisTable,
    place: int,
    stamp_ns: int,
    parameters: TrackManagerParameters,
) -> BoolArray:
    """Which keepers (H,) have no lane, or no plan any more."""
    courses = parameters.courses
    if name == LANE_KEEPING:
        assert courses.lanes is not None
        mean, covariance = table.model_mean[:, place], table.model_covariance[:, place]
        piece = courses.lanes.piece_of(mean[:, :HEAD], covariance[:, :HEAD, :HEAD])
        return np.asarray(piece < 0)
    gone = np.ones(len(table), dtype=bool)
    for rows, plan in _of_plans(table.track_id, courses.plans):
        gone[rows] = stamp_ns >= plan.end_ns
    return gone


def _keepers(
    mixed: tuple[FloatArray, FloatArray],
    table: HypothesisTable,
    full: FloatArray,
    place: int,
    entry: Entries,
    models: ModelSet,
) -> None:
    """Give the keepers at ``place`` the moments of those that stay and those that begin."""
    m, s = len(models), models.size
    h = len(table)
    begun, begun_covariance = models.extended(entry.mean, entry.covariance)
    sources = [*range(m), place]
    share = full[:, place, sources] * table.model_weight[:, sources]
    total = share.sum(axis=1)
    some = np.flatnonzero(total > 0.0)
    mean = np.concatenate([begun.reshape(h, m, s), table.model_mean[:, place : place + 1]], axis=1)
    covariance = np.concatenate(
        [begun_covariance.reshape(h, m, s, s), table.model_covariance[:, place : place + 1]], axis=1
    )
    mixed[0][some, place], mixed[1][some, place] = moments(
        share[some] / total[some, None], mean[some], covariance[some]
    )


def _moved(
    name: str,
    mean: FloatArray,
    covariance: FloatArray,
    track_id: IntArray,
    times_ns: tuple[int, int],
    parameters: TrackManagerParameters,
) -> tuple[FloatArray, FloatArray]:
    """Keepers (H, 4), (H, 4, 4) at the later of two times; those without a course go straight."""
    courses, dt_s = parameters.courses, (times_ns[1] - times_ns[0]) / 1e9
    density = parameters.process_noise_std_mps2**2
    models = ModelSet(
        ("white_noise_acceleration",), (parameters.process_noise_std_mps2,), 1.0, 1.0, 1.0, 1.0
    )
    (transition,), (noise,) = models.matrices(dt_s)
    after = mean @ transition.T
    spread = transition @ covariance @ transition.T + noise
    if name == LANE_KEEPING:
        assert courses.lanes is not None
        piece = courses.lanes.piece_of(mean, covariance)
        on = np.flatnonzero(piece >= 0)
        if len(on):
            after[on], spread[on] = courses.lanes.moved(
                mean[on], covariance[on], piece[on], dt_s, density
            )
        return after, spread
    for rows, plan in _of_plans(track_id, courses.plans):
        after[rows], spread[rows] = plan.moved(mean[rows], covariance[rows], *times_ns)
    return after, spread


def _of_plans(
    track_id: IntArray, plans: dict[int, PlanCourse]
) -> list[tuple[IntArray, PlanCourse]]:
    """Rows of the tracks that have a plan, with it."""
    found = np.flatnonzero(np.isin(track_id, list(plans)))
    return [
        (found[track_id[found] == track], plans[int(track)])
        for track in np.unique(track_id[found]).tolist()
    ]
