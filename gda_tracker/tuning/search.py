"""The search: Optuna proposes points in batches, processes score them, the storage keeps them.

A batch of a fixed size is proposed before any of it is scored, with random numbers that depend on
the seed and the number of trials before it alone. So one uninterrupted search gives the same trials
whatever the number of workers and their speed. Several commands on one storage share the work; they
see each other's trials, hence what each proposes depends on who is faster.
"""

from __future__ import annotations

import json
import math
import os
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gda_tracker.errors import UserError
from gda_tracker.termination import interrupt_noted
from gda_tracker.tuning.cases import Case, fingerprint
from gda_tracker.tuning.objectives import Objective, values_of
from gda_tracker.tuning.scores import CaseScore, measures
from gda_tracker.tuning.search_space import Range, Values, base_point, with_point
from gda_tracker.tuning.storage import require_optuna
from gda_tracker.tuning.workers import Answer, Workers

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import BaseStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial, Trial

# Trials proposed at once. Not the number of workers: results must not depend on that.
BATCH = 8
# Names of what is kept with the study and its trials.
PROBLEM, BASELINE = "problem", "baseline"
MEASURES, ERROR, OWNER, AGAIN = "measures", "error", "owner", "again"

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Problem:
    """What is searched: parameters on top of ``base`` in ``space``, scored on ``cases``."""

    base: Values
    space: Sequence[Range]
    objectives: Sequence[Objective]
    cases: Sequence[Case]
    seed: int

    def parameters(self, point: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        """Parameters of the nodes at a point."""
        return with_point(self.base, self.space, point)

    def described(self) -> dict[str, Any]:
        """What must be the same for trials to be compared, part by part."""
        return {
            "recordings": [case.name for case in self.cases],
            "scans and truth": fingerprint(self.cases),
            "objectives": [objective.name for objective in self.objectives],
            "parameters": json.dumps(self.base, sort_keys=True),
            "ranges": [json.dumps(asdict(item), sort_keys=True) for item in self.space],
        }


@dataclass(frozen=True)
class Outcome:
    """One point and what it reached; ``number`` is the trial's, -1 the baseline's."""

    number: int
    point: dict[str, Any]
    values: list[float]
    measures: dict[str, float | None]


@dataclass(frozen=True)
class Found:
    """A study so far: the default, all points scored, and those that failed with the reason."""

    baseline: Outcome
    trials: list[Outcome]
    failed: list[tuple[int, dict[str, Any], str]]


def open_study(problem: Problem, storage: BaseStorage, name: str) -> Study:
    """Open or begin a study.

    Raises
    ------
    UserError
        If there is a study of this name that searches something else.
    """
    require_optuna()
    import optuna

    directions = [objective.direction for objective in problem.objectives]
    mine = problem.described()
    names = [summary.study_name for summary in optuna.get_all_study_summaries(storage)]
    if name in names:
        study = optuna.load_study(study_name=name, storage=storage)
    else:
        study = optuna.create_study(
            storage=storage, study_name=name, directions=directions, load_if_exists=True
        )
    known = study.user_attrs.get(PROBLEM)
    if known is None:
        study.set_user_attr(PROBLEM, mine)
    elif known != mine:
        other = [part for part in mine if known.get(part) != mine[part]]
        raise UserError(
            f"--study {name}: the storage has a study of this name with other "
            f"{', '.join(other)}; choose another name or storage"
        )
    return study


def search(
    problem: Problem,
    study: Study,
    workers: Workers,
    n_trials: int,
    progress: Progress = lambda done, total: None,
) -> None:
    """Score the default, then points until the study has ``n_trials`` of them.

    Ctrl-C ends it with ``KeyboardInterrupt``; trials that were under way are done again by the
    next search on the same study, as are those of a process of this machine that has died.

    Raises
    ------
    UserError
        If the default parameters cannot be scored.
    """
    _take_up_the_dead(study)
    with interrupt_noted() as interrupted:

        def check() -> None:
            if interrupted:
                raise KeyboardInterrupt

        if BASELINE not in study.user_attrs:
            _score_baseline(problem, study, workers, check)
        distributions = {item.name: _distribution(item) for item in problem.space}
        while left := n_trials - _counted(study):
            if left < 0:
                break
            check()
            progress(n_trials - left, n_trials)
            batch = _propose(problem, study, distributions, min(left, BATCH))
            done = n_trials - left
            with _kept(study, batch) as open_trials:
                points = [problem.parameters(trial.params) for trial in batch]
                for place, answer in workers.score(points, check):
                    _tell(problem, study, batch[place], answer)
                    open_trials.discard(batch[place].number)
                    done += 1
                    progress(done, n_trials)


def results(problem: Problem, study: Study) -> Found:
    """What a study has found so far, by all who took part."""
    from optuna.trial import TrialState

    known = study.user_attrs[BASELINE]
    baseline = Outcome(-1, known["point"], known["values"], known[MEASURES])
    repeated = _repeated(study)
    trials, failed = [], []
    for trial in study.get_trials(deepcopy=False):
        if trial.user_attrs.get(BASELINE):
            continue
        if trial.state is TrialState.COMPLETE:
            trials.append(
                Outcome(trial.number, trial.params, trial.values, trial.user_attrs[MEASURES])
            )
        elif trial.state is TrialState.FAIL and trial.number not in repeated:
            failed.append((trial.number, trial.params, trial.user_attrs.get(ERROR, "unknown")))
    return Found(baseline, trials, failed)


def score_points(parameters: Sequence[Values], workers: Workers) -> list[list[CaseScore]]:
    """Score parameters on the cases of ``workers``; Ctrl-C is heard.

    Raises
    ------
    UserError
        If one of them cannot be scored.
    """
    found: dict[int, list[CaseScore]] = {}
    with interrupt_noted() as interrupted:

        def check() -> None:
            if interrupted:
                raise KeyboardInterrupt

        for place, answer in workers.score(parameters, check):
            if answer.error:
                raise UserError(f"parameters cannot be scored: {answer.error}")
            found[place] = answer.scores
    return [found[place] for place in range(len(parameters))]


def _score_baseline(
    problem: Problem, study: Study, workers: Workers, check: Callable[[], None]
) -> None:
    import optuna

    point = base_point(problem.base, problem.space)
    ((_, answer),) = workers.score([problem.base], check)
    if answer.error:
        raise UserError(f"the default parameters cannot be scored: {answer.error}")
    measured = measures(answer.scores)
    values = values_of(problem.objectives, measured)
    if all(point[item.name] in item for item in problem.space):
        # The proposals learn from it too.
        study.add_trial(
            optuna.create_trial(
                params=point,
                distributions={item.name: _distribution(item) for item in problem.space},
                values=values,
                user_attrs={BASELINE: True, MEASURES: measured},
            )
        )
    study.set_user_attr(BASELINE, {"point": point, "values": values, MEASURES: measured})


def _propose(
    problem: Problem, study: Study, distributions: dict[str, BaseDistribution], count: int
) -> list[Trial]:
    import optuna

    before = len(study.get_trials(deepcopy=False))
    state = np.random.SeedSequence([problem.seed, before]).generate_state(1)
    study.sampler = optuna.samplers.TPESampler(
        multivariate=True, constant_liar=True, n_startup_trials=2 * BATCH, seed=int(state[0])
    )
    batch = []
    for _ in range(count):
        trial = study.ask(distributions)
        trial.set_user_attr(OWNER, _owner(os.getpid()))
        batch.append(trial)
    return batch


def _tell(problem: Problem, study: Study, trial: Trial, answer: Answer) -> None:
    from optuna.trial import TrialState

    error = answer.error
    if not error:
        measured = measures(answer.scores)
        try:
            values = values_of(problem.objectives, measured)
        except ValueError as problem_of_values:
            error = str(problem_of_values)
        else:
            if all(math.isfinite(value) for value in values):
                trial.set_user_attr(MEASURES, measured)
                study.tell(trial, values)
                return
            error = f"{values} are not finite"
    trial.set_user_attr(ERROR, error)
    study.tell(trial, state=TrialState.FAIL)


@contextmanager
def _kept(study: Study, batch: Sequence[Trial]) -> Iterator[set[int]]:
    """Give back the trials whose numbers are left in the set, whatever happens."""
    numbers = {trial.number for trial in batch}
    try:
        yield numbers
    finally:
        for trial in batch:
            if trial.number in numbers:
                _give_back(study, trial.number, trial.params)


def _give_back(study: Study, number: int, params: dict[str, Any]) -> None:
    """End a trial without a result; its point is the next to be proposed."""
    from optuna.trial import TrialState

    study.tell(number, state=TrialState.FAIL)
    study.enqueue_trial(params, user_attrs={AGAIN: number})


def _take_up_the_dead(study: Study) -> None:
    """Give back the trials of processes of this machine that have died."""
    for trial in _running(study):
        host, _, process = trial.user_attrs.get(OWNER, "").rpartition(":")
        if host == socket.gethostname() and not _alive(int(process)):
            _give_back(study, trial.number, trial.params)


def _running(study: Study) -> list[FrozenTrial]:
    from optuna.trial import TrialState

    return study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _owner(process: int) -> str:
    return f"{socket.gethostname()}:{process}"


def _repeated(study: Study) -> set[int]:
    """Numbers of trials that were given back: another one stands for each."""
    found = (trial.user_attrs.get(AGAIN) for trial in study.get_trials(deepcopy=False))
    return {number for number in found if number is not None}


def _counted(study: Study) -> int:
    """Trials that are done or under way, without the baseline and those given back."""
    from optuna.trial import TrialState

    repeated = _repeated(study)
    return sum(
        trial.state is not TrialState.WAITING
        and trial.number not in repeated
        and not trial.user_attrs.get(BASELINE)
        for trial in study.get_trials(deepcopy=False)
    )


def _distribution(item: Range) -> BaseDistribution:
    from optuna.distributions import (
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
    )

    if item.choices:
        return CategoricalDistribution(item.choices)
    if item.specification.element_kind is int:
        return IntDistribution(int(item.low), int(item.high), log=item.log)
    return FloatDistribution(item.low, item.high, log=item.log)
