"""Monte Carlo over all cores: the same simulated scans for every method, the same result always.

A run depends on (scenario, seed, run) alone and results are combined in the order of the runs, so
neither the number of workers nor their speed changes anything but the processor times.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait

from gda_tracker.evaluation.processes import (
    available_cores,
    garbage_left,
    interrupt_held,
    one_thread_per_worker,
    start_worker,
)
from gda_tracker.evaluation.results import ScenarioResult, combine
from gda_tracker.evaluation.runs import (
    AUTOMATIC,
    INITIATIONS,
    LABELLED,
    RunScore,
    default_match_distance_m,
    method_parameters,
    score_runs,
)
from gda_tracker.formations.parameters import FormationParameters
from gda_tracker.parameters import ParameterError
from gda_tracker.simulation.scenarios import Scenario
from gda_tracker.termination import interrupt_noted

DEFAULT_METHODS = ("gda/none/cv", "gda/dsm_classic/cv", "map/bayes/cv", "default")
# How soon Ctrl-C is heard while all workers are busy [s].
INTERRUPT_CHECK_S = 0.2
LONGEST_CHUNK = 5

Progress = Callable[[int, int], None]


def monte_carlo(
    scenarios: Sequence[Scenario],
    methods: Sequence[str] = DEFAULT_METHODS,
    runs: int = 100,
    seed: int = 0,
    *,
    initiation: str = LABELLED,
    match_distance_m: float | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    formations: FormationParameters | None = None,
) -> list[ScenarioResult]:
    """Evaluate methods on scenarios.

    Parameters
    ----------
    scenarios
        What to simulate.
    methods
        ``decision/attribute_term/filter`` or ``clairvoyant``; differences are taken to the first. A
        method that is named twice is evaluated once.
    runs, seed
        Runs 0 to ``runs - 1`` of this seed.
    initiation
        ``labelled``: tracks start from the labelled detections of the first scans, scored by
        purity. ``automatic``: the whole tracker, scored by continuity.
    match_distance_m
        For automatic initiation; ``None`` takes three standard deviations of a measured position.
    workers
        Processes; ``None`` one per core that this process may use, 1 works in this process.
    progress
        Called in this process with the runs done and the runs in all.
    formations
        For automatic initiation: follow formations with these parameters, and score them too.

    Returns
    -------
    list of ScenarioResult
        In the order of ``scenarios``.

    Raises
    ------
    ParameterError
        If an argument is not allowed; before anything is simulated.
    """
    methods = list(dict.fromkeys(methods))
    workers = available_cores() if workers is None else workers
    _check(scenarios, methods, runs, seed, initiation, match_distance_m, workers)
    if formations is not None and initiation != AUTOMATIC:
        raise ParameterError(
            f"formations with initiation = {initiation!r}: allowed is {AUTOMATIC}, for given "
            "tracks never end"
        )
    for scenario in scenarios:
        for method in methods:
            method_parameters(scenario, method, initiation)
    distances = [_match_distance(s, initiation, match_distance_m) for s in scenarios]
    size = min(LONGEST_CHUNK, math.ceil(len(scenarios) * runs / (4 * workers)))
    chunks = [
        (index, range(begin, min(begin + size, runs)))
        for index in range(len(scenarios))
        for begin in range(0, runs, size)
    ]
    tasks = [
        (scenarios[index], tuple(methods), seed, chunk, initiation, distances[index], formations)
        for index, chunk in chunks
    ]
    answers = _in_order(tasks, min(workers, len(tasks)), len(scenarios) * runs, progress)
    scores: list[list[list[RunScore]]] = [[] for _ in scenarios]
    for (index, _), answer in zip(chunks, answers, strict=True):
        scores[index] += answer
    return [
        combine(scenario, methods, seed, initiation, distance, score)
        for scenario, distance, score in zip(scenarios, distances, scores, strict=True)
    ]


Task = tuple[Scenario, tuple[str, ...], int, range, str, float | None, FormationParameters | None]


def _score_chunk(task: Task) -> list[list[RunScore]]:
    scenario, methods, seed, chunk, initiation, distance, formations = task
    return score_runs(scenario, methods, seed, chunk, initiation, distance, formations)


def _in_order(
    tasks: list[Task], workers: int, total: int, progress: Progress | None
) -> list[list[list[RunScore]]]:
    """Answers of all tasks in the order of the tasks."""
    done = 0

    def report(task: Task) -> None:
        nonlocal done
        done += len(task[3])
        if progress is not None:
            progress(done, total)

    if workers == 1:
        answers = []
        with garbage_left():
            for task in tasks:
                answers.append(_score_chunk(task))
                report(task)
        return answers
    with one_thread_per_worker(), interrupt_noted() as interrupted:
        executor = ProcessPoolExecutor(
            workers, mp_context=multiprocessing.get_context("spawn"), initializer=start_worker
        )
        found: dict[int, list[list[RunScore]]] = {}
        waiting: dict[Future[list[list[RunScore]]], int] = {}
        try:
            # A short queue: an interruption has little to call back, however many runs are left.
            for place, task in enumerate(tasks):
                with interrupt_held():
                    future = executor.submit(_score_chunk, task)
                waiting[future] = place
                while waiting and (len(waiting) > 2 * workers or place + 1 == len(tasks)):
                    if interrupted:
                        raise KeyboardInterrupt
                    for answer in wait(waiting, INTERRUPT_CHECK_S, FIRST_COMPLETED).done:
                        done_place = waiting.pop(answer)
                        found[done_place] = answer.result()  # or the error of the worker
                        report(tasks[done_place])
            if interrupted:
                raise KeyboardInterrupt
            return [found[place] for place in range(len(tasks))]
        finally:
            # After Ctrl-C only the chunks that have begun, some seconds at most, are waited for.
            executor.shutdown(wait=True, cancel_futures=True)


def _match_distance(
    scenario: Scenario, initiation: str, match_distance_m: float | None
) -> float | None:
    if initiation != AUTOMATIC:
        return None
    return match_distance_m or default_match_distance_m(scenario)


def _check(
    scenarios: Sequence[Scenario],
    methods: list[str],
    runs: int,
    seed: int,
    initiation: str,
    match_distance_m: float | None,
    workers: int,
) -> None:
    if not scenarios:
        raise ParameterError("scenarios = []: allowed is one or more")
    if not methods:
        raise ParameterError("methods = []: allowed is one or more")
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0), ("workers", workers, 1)):
        if value < least:
            raise ParameterError(f"{name} = {value}: allowed is an integer >= {least}")
    if initiation not in INITIATIONS:
        allowed = ", ".join(INITIATIONS)
        raise ParameterError(f"initiation = {initiation!r}: allowed is one of {allowed}")
    if match_distance_m is not None and not (0.0 < match_distance_m < math.inf):
        raise ParameterError(f"match_distance_m = {match_distance_m}: allowed is a number > 0 [m]")
