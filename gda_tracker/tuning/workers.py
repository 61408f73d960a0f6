"""Processes that score points side by side; each may fail or die without harm to the others.

The executors of the standard library give up all work when one of their processes dies, and cannot
end one that is busy. Here each worker has a pipe of its own.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.evaluation.processes import interrupt_held, one_thread_per_worker, start_worker
from gda_tracker.tuning.cases import Case
from gda_tracker.tuning.scores import CaseScore, score_case
from gda_tracker.tuning.search_space import Values

# How soon Ctrl-C and a limit of time are heard while all workers are busy [s].
CHECK_S = 0.2
LONGEST_REASON = 300


@dataclass(frozen=True)
class Answer:
    """Scores of all cases, or why there are none, in one line."""

    scores: list[CaseScore]
    error: str = ""


@dataclass
class _Worker:
    process: multiprocessing.process.BaseProcess
    pipe: Connection
    task: int | None = None
    since: float = 0.0


class Workers:
    """Scores parameters on cases, in processes; to be used in a ``with`` statement.

    Parameters
    ----------
    cases
        What to score on; every process gets them once.
    count
        How many processes.
    time_limit_s
        A task that takes longer is ended and has failed; 0: none is.
    """

    def __init__(self, cases: Sequence[Case], count: int, time_limit_s: float = 0.0) -> None:
        self._cases = list(cases)
        self._count = count
        self._limit_s = time_limit_s
        self._workers: list[_Worker] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            _end(worker)
        self._workers = []

    def score(
        self, parameters: Sequence[Values], check: Callable[[], None] = lambda: None
    ) -> Iterator[tuple[int, Answer]]:
        """Yield the place and the answer of each entry of ``parameters``, as they come.

        ``check`` is called several times a second and may raise to stop the waiting.
        """
        left = list(enumerate(parameters))[::-1]
        while left or any(worker.task is not None for worker in self._workers):
            check()
            self._hand_out(left, parameters)
            busy = [worker for worker in self._workers if worker.task is not None]
            ready = wait([worker.pipe for worker in busy], CHECK_S)
            for worker in busy:
                place = worker.task
                assert place is not None
                if worker.pipe in ready:
                    answer = self._receive(worker)
                elif 0.0 < self._limit_s < time.monotonic() - worker.since:
                    self._drop(worker)
                    answer = Answer([], f"took longer than {self._limit_s:g} s")
                else:
                    continue
                worker.task = None
                yield place, answer

    def _hand_out(self, left: list[tuple[int, Values]], parameters: Sequence[Values]) -> None:
        while left:
            free = next((worker for worker in self._workers if worker.task is None), None)
            if free is None:
                if len(self._workers) >= min(self._count, len(parameters)):
                    return
                free = _start(self._cases)
                self._workers.append(free)
            place, values = left.pop()
            free.task, free.since = place, time.monotonic()
            try:
                free.pipe.send(values)
            except OSError:
                # It died idle; the task is for another.
                self._drop(free)
                left.append((place, values))

    def _receive(self, worker: _Worker) -> Answer:
        try:
            answer = worker.pipe.recv()
        except (EOFError, OSError):
            self._drop(worker)
            code = worker.process.exitcode or 0
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            return Answer([], f"the process that scored it died ({how})")
        assert isinstance(answer, Answer)
        return answer

    def _drop(self, worker: _Worker) -> None:
        _end(worker)
        self._workers.remove(worker)


def _start(cases: Sequence[Case]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    with one_thread_per_worker(), interrupt_held():
        process.start()
    theirs.close()
    worker = _Worker(process, ours)
    ours.send(cases)
    return worker


def _end(worker: _Worker) -> None:
    worker.process.kill()
    worker.process.join()
    worker.pipe.close()


def _serve(pipe: Connection) -> None:
    """Answer until the pipe closes."""
    # Ctrl-C at a terminal reaches all processes; the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    start_worker()
    # Whoever looks at the list of processes shall see that this one may wait.
    os.nice(1)
    cases: list[Case] = pipe.recv()
    while True:
        try:
            parameters: dict[str, dict[str, Any]] = pipe.recv()
        except EOFError:
            return
        pipe.send(_answer(cases, parameters))


def _answer(cases: Sequence[Case], parameters: Values) -> Answer:
    try:
        return Answer([score_case(case, parameters) for case in cases])
    except UserError as error:
        return Answer([], str(error))
    except Exception as error:  # the trial fails and is named; the search goes on
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer([], text[:LONGEST_REASON])
