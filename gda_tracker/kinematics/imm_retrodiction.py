"""Retrodiction with interacting multiple models: Koch 2014, section 3.4.3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gda_tracker.kinematics import imm
from gda_tracker.kinematics.mixtures import moments
from gda_tracker.kinematics.retrodiction import retrodiction_gain, step_back
from gda_tracker.vocabulary.arrays import FloatArray


@dataclass(slots=True)
class ModelMixtures:
    """States of H hypotheses over M models at one time: (H, M), (H, M, s), (H, M, s, s)."""

    weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


def retrodict_imm(
    filtered: ModelMixtures,
    later: ModelMixtures,
    switching: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
    moved: FloatArray | None = None,
) -> ModelMixtures:
    """One step back with interacting multiple models.

    Parameters
    ----------
    filtered
        After the update at time l (not mixed).
    later
        Retrodicted at time l + 1.
    switching
        (M, M) or (H, M, M) from l to l + 1, entry [j, i] = p(j | i).
    transition, noise
        F and Q (M, s, s) of the models from l to l + 1. For models that depend on the state F may
        be the derivative (H, M, M, s, s), entry [h, j, i] that of model j at the filtered state i.
    moved
        (H, M, M, s) the filtered states moved likewise; ``None``: by F.

    Returns
    -------
    ModelMixtures
        Retrodicted at time l.

    Notes
    -----
    For j the model at l + 1 and i that at l: S_ji = F_j P_i F_j' + D_j, W_ji = P_i F_j' S_ji^-1,
    c_ji ~ p(j|i) p_i N(x^j_later; F_j x_i, S_ji) normalised over i, p_ji = c_ji p^j_later;
    x_ji = x_i + W_ji (x^j_later - F_j x_i), P_ji = P_i + W_ji (P^j_later - S_ji) W_ji'; moments
    matched over j (Koch 2014, (3.91)-(3.100), with F applied once in (3.95)).
    """
    forward, back, spread = _model_pairs(filtered, later, switching, transition, noise, moved)
    pair = forward * later.weight[:, :, None]
    weight = pair.sum(axis=1)
    count = pair.shape[1]
    reachable = weight[:, None, :] > 0.0
    share = np.where(reachable, pair / np.where(reachable, weight[:, None, :], 1.0), 1.0 / count)
    # Over the later model j, axis 1, for every earlier one i.
    mean, covariance = moments(
        share.transpose(0, 2, 1), back.transpose(0, 2, 1, 3), spread.transpose(0, 2, 1, 3, 4)
    )
    return ModelMixtures(weight, mean, covariance)


def _model_pairs(
    filtered: ModelMixtures,
    later: ModelMixtures,
    switching: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
    moved: FloatArray | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """c_ji (H, M, M), x_ji (H, M, M, s), P_ji (H, M, M, s, s); axes: hypothesis, j, i."""
    f = transition[:, None] if transition.ndim == 3 else transition
    mean, covariance = filtered.mean[:, None], filtered.covariance[:, None]
    if moved is None:
        moved = (f @ mean[..., None])[..., 0]
    crossed = f @ covariance
    spread = crossed @ np.swapaxes(f, -1, -2) + noise[:, None]
    gap = later.mean[:, :, None] - moved
    squared = np.sum(gap * np.linalg.solve(spread, gap[..., None])[..., 0], axis=-1)
    log_density = -0.5 * (squared + np.linalg.slogdet(spread)[1])
    with np.errstate(divide="ignore"):
        log_pair = log_density + np.log(switching * filtered.weight[:, None, :])
    peak = log_pair.max(axis=-1, keepdims=True)
    # A model that nothing could lead to has no weight later either: any share will do.
    scaled = np.where(np.isneginf(peak), 1.0, np.exp(log_pair - np.where(peak > -np.inf, peak, 0)))
    share = scaled / scaled.sum(axis=-1, keepdims=True)
    back, reduced = step_back(
        mean,
        covariance,
        moved,
        spread,
        retrodiction_gain(crossed, spread),
        later.mean[:, :, None],
        later.covariance[:, :, None],
    )
    return share, back, reduced


def fixed_interval_imm(
    filtered: Sequence[ModelMixtures],
    switching: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
) -> list[ModelMixtures]:
    """All states of K scans given all of them, with interacting multiple models.

    ``switching`` (K - 1, M, M), ``transition``, ``noise`` (K - 1, M, s, s); entry l leads from scan
    l to scan l + 1.
    """
    back = list(filtered)
    for step in range(len(filtered) - 2, -1, -1):
        back[step] = retrodict_imm(
            filtered[step], back[step + 1], switching[step], transition[step], noise[step]
        )
    return back


def fixed_lag_imm(
    filtered: Sequence[ModelMixtures],
    switching: FloatArray,
    transition: FloatArray,
    noise: FloatArray,
    lag: int,
) -> list[ModelMixtures]:
    """Every state given the scans up to ``lag`` later; arguments as in fixed_interval_imm."""
    if lag < 0:
        raise ValueError(f"lag = {lag}: allowed is an integer >= 0")
    back = []
    for first in range(len(filtered)):
        end = min(first + lag, len(filtered) - 1)
        state = filtered[end]
        for step in range(end - 1, first - 1, -1):
            state = retrodict_imm(
                filtered[step], state, switching[step], transition[step], noise[step]
            )
        back.append(state)
    return back


def between_imm(
    filtered: ModelMixtures,
    later: ModelMixtures,
    first: tuple[FloatArray, FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray, FloatArray],
) -> ModelMixtures:
    """Retrodict to a time between two scans with interacting multiple models.

    ``first`` and ``second`` hold switching (M, M), F and Q (M, s, s) from the earlier scan to the
    time and from there to the later scan. The prediction to the time takes the place of the
    filtered state in :func:`retrodict_imm`.
    """
    weight, mean, covariance = imm.mix(
        filtered.weight, filtered.mean, filtered.covariance, first[0]
    )
    mean, covariance = imm.predict(mean, covariance, first[1], first[2])
    return retrodict_imm(ModelMixtures(weight, mean, covariance), later, *second)
