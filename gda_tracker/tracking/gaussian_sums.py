"""Gaussian sums on the table of hypotheses: states that no single Gaussian describes.

What a bearing or a time difference leaves of a target's position is a curve. Such a hypothesis is a
sum of parts, each with the motion models of the filter; the table holds part after part in the
columns of the models, ``spread`` parts in every row, those that a row has not with weight 0. The
parts are predicted each on its own, updated and weighted like models, and after every scan pruned,
merged and capped. When one part is left everywhere the table is an ordinary one again.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.gaussian_sum_starts import Sums
from gda_tracker.kinematics.mixtures import GaussianMixtures, merge_groups
from gda_tracker.kinematics.model_sets import HEAD, follow_head
from gda_tracker.kinematics.pair_updates import updated_pairs
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import has_models, merge_pairs, set_models, with_models
from gda_tracker.tracking.parameters import TrackManagerParameters
from gda_tracker.vocabulary.arrays import FloatArray, Int32Array, IntArray
from gda_tracker.vocabulary.scans import Scan


def update_by_model(
    table: HypothesisTable, scan: Scan, rows: IntArray, detection: Int32Array
) -> None:
    """Update hypotheses ``rows`` (R,) with detections (R,) of a sensor with a model of its own.

    Every component is updated, and their weights follow the likelihoods (Koch 2014, (3.45)-(3.48)).
    """
    count = table.model_weight.shape[1]
    if not count:
        mean, covariance = table.mean.copy(), table.covariance.copy()
        mean[rows], covariance[rows], _ = updated_pairs(
            scan, table.mean[rows], table.covariance[rows], detection
        )
        table.mean, table.covariance = mean, covariance
        return
    size = table.model_mean.shape[2]
    whole = table.model_mean[rows].reshape(-1, size)
    spread = table.model_covariance[rows].reshape(-1, size, size)
    new_mean, new_covariance, log_likelihood = updated_pairs(
        scan, whole[:, :HEAD], spread[:, :HEAD, :HEAD], np.repeat(detection, count)
    )
    if size > HEAD:
        new_mean, new_covariance = follow_head(whole, spread, new_mean, new_covariance)
    weight = table.model_weight.copy()
    mean, covariance = table.model_mean.copy(), table.model_covariance.copy()
    weight[rows], _ = imm.reweight(table.model_weight[rows], log_likelihood.reshape(-1, count))
    mean[rows] = new_mean.reshape(-1, count, size)
    covariance[rows] = new_covariance.reshape(-1, count, size, size)
    set_models(table, weight, mean, covariance)


def parts_of(table: HypothesisTable) -> tuple[HypothesisTable, FloatArray]:
    """The parts of H hypotheses as H G rows without a sum, states alone, and their weights (H, G).

    The models of a part without weight are equally probable.
    """
    h, g = len(table), table.spread
    size = table.model_mean.shape[2]
    own = table.model_weight.reshape(h * g, -1)
    weight = own.sum(axis=1)
    per = own.shape[1]
    inner = np.where(
        weight[:, None] > 0.0, own / np.where(weight > 0.0, weight, 1.0)[:, None], 1.0 / per
    )
    mean = table.model_mean.reshape(h * g, per, size)
    covariance = table.model_covariance.reshape(h * g, per, size, size)
    rows = HypothesisTable(
        hypothesis_id=np.zeros(h * g, dtype=np.int64),
        mean=mean[:, 0],
        covariance=covariance[:, 0],
        models=table.models,
    )
    if table.models:
        set_models(rows, inner, mean, covariance)
    return rows, weight.reshape(h, g)


def with_parts(table: HypothesisTable, parts: HypothesisTable, weight: FloatArray) -> None:
    """Give H hypotheses the parts (H G rows) and weights (H, G): the reverse of :func:`parts_of`.

    The weights of each hypothesis sum to one.
    """
    h, g = weight.shape
    table.models, table.spread = parts.models, g
    if parts.models:
        own, mean, covariance = parts.model_weight, parts.model_mean, parts.model_covariance
    else:
        own = np.ones((h * g, 1))
        mean, covariance = parts.mean[:, None], parts.covariance[:, None]
    size = mean.shape[-1]
    set_models(
        table,
        (weight.reshape(-1, 1) * own).reshape(h, -1),
        mean.reshape(h, -1, size),
        covariance.reshape(h, -1, size, size),
    )


def merge_components(table: HypothesisTable, parameters: TrackManagerParameters) -> None:
    """End a scan: merge the pairs of models of ``gpb2``, and the parts of sums."""
    if table.spread == 1:
        merge_pairs(table)
        return
    if has_models(parameters) and table.model_weight.shape[1] != table.spread * len(table.models):
        parts, weight = parts_of(table)
        merge_pairs(parts)
        with_parts(table, parts, weight)
    reduce_sums(
        table,
        parameters.gaussian_sum_smallest_share,
        parameters.gaussian_sum_merge_distance,
        parameters.gaussian_sum_components,
    )


def reduce_sums(table: HypothesisTable, smallest_share: float, distance: float, most: int) -> None:
    """Prune, merge and cap the parts of every hypothesis.

    Parameters
    ----------
    table
        Its states are replaced; without sums in the end it is an ordinary table.
    smallest_share
        Parts with less of the weight are left out.
    distance
        Parts nearer than that to a heavier one, in its standard deviations, become one with it.
    most
        Parts that stay.
    """
    if not len(table):
        _end_sums(table)
        return
    parts, weight = parts_of(table)
    h, g = weight.shape
    flat = weight.reshape(-1)
    keep = (weight >= smallest_share) & (weight > 0.0)
    keep[np.arange(h), weight.argmax(axis=1)] = True
    rows = np.flatnonzero(keep.reshape(-1))
    owner = rows // g
    start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=h))])
    mixtures = GaussianMixtures(start, flat[rows], parts.mean[rows], parts.covariance[rows])
    group, holder = merge_groups(mixtures, distance**2)
    total = np.bincount(group, flat[rows], minlength=len(holder))
    # The heaviest groups of each hypothesis first.
    order = np.lexsort((-total, holder))
    first = np.searchsorted(holder[order], np.arange(h))
    rank = np.empty(len(holder), dtype=np.int64)
    rank[order] = np.arange(len(holder)) - first[holder[order]]
    count = min(int(rank.max()) + 1, most)
    place = rank[group]
    stays = place < count
    slot = owner[stays] * count + place[stays]
    _regroup(table, parts, rows[stays], flat[rows[stays]], slot, count)


def _regroup(
    table: HypothesisTable,
    parts: HypothesisTable,
    rows: IntArray,
    weight: FloatArray,
    slot: IntArray,
    count: int,
) -> None:
    """Merge parts ``rows`` (R,) into slots (R,), ``count`` for each hypothesis, by moments."""
    h = len(table)
    if parts.models:
        own = weight[:, None] * parts.model_weight[rows]
        mean, covariance = parts.model_mean[rows], parts.model_covariance[rows]
    else:
        own = weight[:, None]
        mean, covariance = parts.mean[rows][:, None], parts.covariance[rows][:, None]
    per, size = mean.shape[1:]
    total = _sums(own, slot, h * count)
    members = np.maximum(np.bincount(slot, minlength=h * count), 1)
    # A model without weight in a slot is the plain mean of its components.
    share = np.where(
        total[slot] > 0.0,
        own / np.where(total > 0.0, total, 1.0)[slot],
        1.0 / members[slot][:, None],
    )
    # Relative to one of them: no digits are lost on large coordinates.
    anchor = np.zeros((h * count, per, size))
    anchor[slot[::-1]] = mean[::-1]
    shift = mean - anchor[slot]
    centre = _sums(share[..., None] * shift, slot, h * count)
    gap = shift - centre[slot]
    each = covariance + gap[..., :, None] * gap[..., None, :]
    merged = _sums(share[..., None, None] * each, slot, h * count)
    merged = 0.5 * (merged + np.swapaxes(merged, -1, -2))
    means = (anchor + centre).reshape(h, count, per, size)
    merged = merged.reshape(h, count, per, size, size)
    # Slots that a row has not: its first one, with weight 0.
    absent = ~(np.bincount(slot, minlength=h * count) > 0).reshape(h, count)
    hypothesis = np.nonzero(absent)[0]
    means[absent], merged[absent] = means[hypothesis, 0], merged[hypothesis, 0]
    weights = total.reshape(h, count * per)
    weights /= weights.sum(axis=1, keepdims=True)
    table.spread = count
    set_models(
        table,
        weights,
        means.reshape(h, count * per, size),
        merged.reshape(h, count * per, size, size),
    )
    if count == 1:
        _end_sums(table)


def _end_sums(table: HypothesisTable) -> None:
    """Make an ordinary table of one whose hypotheses have one part each."""
    table.spread = 1
    if not table.models:
        h, s = table.mean.shape
        table.model_weight = np.zeros((h, 0))
        table.model_mean, table.model_covariance = np.zeros((h, 0, s)), np.zeros((h, 0, s, s))


def _sums(values: FloatArray, slot: IntArray, count: int) -> FloatArray:
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, slot, values)
    return total


def widened(table: HypothesisTable, spread: int) -> HypothesisTable:
    """Return the table with room for ``spread`` >= its own parts."""
    if table.spread == spread:
        return table
    wide = table.copy()
    if not table.model_weight.shape[1]:
        weight = np.ones((len(table), 1))
        mean, covariance = table.mean[:, None], table.covariance[:, None]
    else:
        weight, mean, covariance = table.model_weight, table.model_mean, table.model_covariance
    per = weight.shape[1] // table.spread
    more = spread - table.spread
    wide.spread = spread
    wide.model_weight = np.concatenate([weight, np.zeros((len(table), more * per))], axis=1)
    wide.model_mean = np.concatenate([mean, np.tile(mean[:, :per], (1, more, 1))], axis=1)
    wide.model_covariance = np.concatenate(
        [covariance, np.tile(covariance[:, :per], (1, more, 1, 1))], axis=1
    )
    return wide


def joined(table: HypothesisTable, other: HypothesisTable) -> HypothesisTable:
    """Return the rows of both, with room for the sums of both."""
    spread = max(table.spread, other.spread)
    return widened(table, spread).append(widened(other, spread))


def set_sums(
    table: HypothesisTable, sums: Sums, rows: IntArray, parameters: TrackManagerParameters
) -> None:
    """Give new hypotheses (D,) the sums of detections, ``rows`` (D,) of them."""
    weight = sums.weight[rows]
    d, g = weight.shape
    parts = HypothesisTable(
        hypothesis_id=np.zeros(d * g, dtype=np.int64),
        mean=sums.mean[rows].reshape(d * g, HEAD),
        covariance=sums.covariance[rows].reshape(d * g, HEAD, HEAD),
    )
    if has_models(parameters):
        parts = with_models(parts, parameters)
    with_parts(table, parts, weight)
    if g == 1:
        _end_sums(table)
