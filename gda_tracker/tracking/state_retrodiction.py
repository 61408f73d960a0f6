"""States of an earlier scan in the light of a later one, whatever filter made them."""

from __future__ import annotations

from gda_tracker.kinematics.imm_retrodiction import ModelMixtures, retrodict_imm
from gda_tracker.kinematics.motion_models import constant_velocity
from gda_tracker.kinematics.retrodiction import retrodict
from gda_tracker.tracking.hypotheses import HypothesisTable
from gda_tracker.tracking.model_states import model_matrices, set_models, switching_matrix
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
        Those of the prediction. Where one of the tables has not the models of the filter ``imm``
        (the filter was changed meanwhile), constant velocity leads from moments to moments.

    Returns
    -------
    HypothesisTable
        As ``earlier``, with retrodicted states (Koch 2014, (3.73), (3.74), with several models
        3.4.3).
    """
    found = earlier.copy()
    if not len(earlier):
        return found
    models = len(parameters.imm_process_noise_factors)
    if (
        parameters.filter == "imm"
        and earlier.model_weight.shape[1] == later.model_weight.shape[1] == models
    ):
        back = retrodict_imm(
            ModelMixtures(earlier.model_weight, earlier.model_mean, earlier.model_covariance),
            ModelMixtures(later.model_weight, later.model_mean, later.model_covariance),
            switching_matrix(dt_s, parameters),
            *model_matrices(dt_s, parameters),
        )
        set_models(found, back.weight, back.mean, back.covariance)
        return found
    transition, noise = constant_velocity(dt_s, parameters.process_noise_std_mps2)
    found.mean, found.covariance = retrodict(
        earlier.mean, earlier.covariance, later.mean, later.covariance, transition, noise
    )
    return found
