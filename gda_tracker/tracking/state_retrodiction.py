"""States of an earlier scan in the light of a later one, whatever filter made them."""

from __future__ import annotations

from gda_tracker.kinematics.imm_retrodiction import ModelMixtures, retrodict_imm
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.retrodiction import retrodict
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import has_models, set_models, switching_matrix
from gda_tracker.tracking.parameters import TrackManagerParameters


def retrodict_states(
    earlier: HypothesisTable,
    later: HypothesisTable,
    dt_s: float,
    parameters: TrackManagerParameters,
) -> HypothesisTable:
    """Take states one scan back: what came later is known to them too.

    Parameters
    ----------
    earlier
        H filtered hypotheses.
    later
        The same ones, row by row, ``dt_s`` [s] later, filtered or retrodicted.
    dt_s
        Time between the two.
    parameters
        Those of the prediction. Where one of the tables has not their models (the filter was
        changed meanwhile), or holds Gaussian sums, constant velocity leads from moments to moments.

    Returns
    -------
    HypothesisTable
        As ``earlier``, with retrodicted states (Koch 2014, (3.73), (3.74), with several models
        3.4.3).
    """
    found = earlier.copy()
    if not len(earlier):
        return found
    models = parameters.model_set
    plain = earlier.spread == later.spread == 1
    if plain and has_models(parameters) and earlier.models == later.models == models.names:
        moved, slope = (None, models.matrices(dt_s)[0])
        if models.turns:
            moved, slope = models.moved_pairs(earlier.model_mean, dt_s)
        back = retrodict_imm(
            ModelMixtures(earlier.model_weight, earlier.model_mean, earlier.model_covariance),
            ModelMixtures(later.model_weight, later.model_mean, later.model_covariance),
            switching_matrix(earlier, dt_s, parameters),
            slope,
            models.matrices(dt_s)[1],
            moved,
        )
        set_models(found, back.weight, back.mean, back.covariance)
        return found
    transition, noise = constant_velocity(dt_s, parameters.process_noise_std_mps2)
    found.mean, found.covariance = retrodict(
        earlier.mean, earlier.covariance, later.mean, later.covariance, transition, noise
    )
    return found
