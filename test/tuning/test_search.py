"""The search: the same whatever the workers, kept and gone on with, not ended by one trial."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time

import optuna
import pytest
from optuna.trial import TrialState
from tuning_examples import short_base, short_cases, short_problem

from gda_tracker.errors import UserError
from gda_tracker.tuning import search as searching
from gda_tracker.tuning.report import importances
from gda_tracker.tuning.search import open_study, results, score_points, search
from gda_tracker.tuning.storage import open_storage
from gda_tracker.tuning.workers import Workers


@pytest.fixture(scope="module")
def workers():
    """Two processes that know the short case, for all tests that need no others."""
    with Workers(short_cases(), 2) as pool:
        yield pool


@pytest.fixture
def storage(tmp_path):
    return open_storage(str(tmp_path / "study.journal"))


def points(found):
    return [(trial.number, trial.point, trial.values) for trial in found.trials]


def test_trials_depend_on_the_seed_alone_not_on_the_workers(workers, storage):
    problem = short_problem()
    one, two = open_study(problem, storage, "one"), open_study(problem, storage, "two")
    done = []
    search(problem, one, workers, 12, lambda now, total: done.append((now, total)))
    with Workers(problem.cases, 1) as single:
        search(problem, two, single, 8)
        search(problem, two, single, 12)
    first, second = results(problem, one), results(problem, two)
    assert first.trials == second.trials
    assert [trial.number for trial in first.trials] == list(range(1, 13))
    assert done[0] == (0, 12)
    assert done[-1] == (12, 12)
    again = open_study(problem, storage, "again")
    search(problem, again, workers, 12)
    assert results(problem, again).trials == first.trials
    other = open_study(problem, storage, "other")
    search(searching.Problem(**{**vars(problem), "seed": 1}), other, workers, 4)
    assert points(results(problem, other))[0] != points(first)[0]
    # What was said of a trial is what its parameters give.
    trial = first.trials[7]
    ((score,),) = score_points([problem.parameters(trial.point)], workers)
    assert math.sqrt(score.total("gospa") / len(score.scans)) == pytest.approx(trial.values[0])


def test_the_search_finds_what_is_better(workers, storage):
    """No track of these fast targets starts under the default; the search mends it."""
    problem = short_problem(["max_speed_mps=20:600:log"], max_speed_mps=50.0)
    study = open_study(problem, storage, "tune")
    search(problem, study, workers, 24)
    found = results(problem, study)
    best = min(found.trials, key=lambda trial: trial.values)
    assert best.values[0] < 0.9 * found.baseline.values[0]
    assert best.point["max_speed_mps"] > 100.0
    assert importances(study, problem, found) == {"GOSPA": {"max_speed_mps": 1.0}}
    assert importances(study, problem, found, trials=25) == {}


def test_two_objectives_go_both_ways(workers, storage):
    problem = short_problem(objectives=("completeness", "false_tracks"))
    study = open_study(problem, storage, "tune")
    search(problem, study, workers, 4)
    assert [direction.name for direction in study.directions] == ["MAXIMIZE", "MINIMIZE"]
    for trial in results(problem, study).trials:
        assert trial.values == [trial.measures["completeness"], trial.measures["false_tracks"]]


def test_points_that_are_not_allowed_fail_by_name_and_the_search_goes_on(workers, storage):
    problem = short_problem(["confirmation_hits=2:5", "confirmation_scans=2:5"])
    study = open_study(problem, storage, "tune")
    search(problem, study, workers, 16)
    found = results(problem, study)
    assert len(found.trials) + len(found.failed) == 16
    assert found.failed
    for _, point, reason in found.failed:
        assert point["confirmation_hits"] > point["confirmation_scans"]
        assert reason.startswith("parameter confirmation_hits = ")


def test_a_default_that_cannot_be_scored_is_an_error(workers, storage):
    problem = short_problem(confirmation_hits=5, confirmation_scans=4)
    study = open_study(problem, storage, "tune")
    with pytest.raises(UserError, match="the default parameters cannot be scored: .*confirmation"):
        search(problem, study, workers, 2)
    with pytest.raises(UserError, match="cannot be scored: .*confirmation_hits"):
        score_points([problem.base], workers)


def test_a_default_outside_the_ranges_is_compared_with_all_the_same(workers, storage):
    problem = short_problem(["process_noise_std_mps2=40:90"])
    study = open_study(problem, storage, "tune")
    search(problem, study, workers, 2)
    found = results(problem, study)
    assert found.baseline.point == {"process_noise_std_mps2": 18.0}
    assert len(found.trials) == 2
    assert [trial.number for trial in found.trials] == [0, 1]


def test_a_worker_that_dies_fails_its_trial_alone():
    with Workers(short_cases(), 1) as pool:
        list(pool.score([short_base()]))
        (process,) = [worker.process for worker in pool._workers]
        timer = threading.Timer(0.0, os.kill, (process.pid, signal.SIGSTOP))
        timer.start()
        timer.join()
        kill = threading.Timer(0.5, os.kill, (process.pid, signal.SIGKILL))
        kill.start()
        answers = dict(pool.score([short_base(), short_base()]))
        kill.join()
    assert answers[0].error == "the process that scored it died (signal SIGKILL)"
    assert not answers[1].error
    assert len(answers[1].scores) == 1


def test_a_trial_that_takes_too_long_fails_and_its_process_ends():
    with Workers(short_cases(), 1, time_limit_s=0.001) as pool:
        ((_, answer),) = pool.score([short_base()])
        assert answer.error == "took longer than 0.001 s"
        assert not pool._workers


def test_ctrl_c_gives_unfinished_trials_back(workers, storage):
    problem = short_problem()
    study = open_study(problem, storage, "tune")

    def stop(done, total):
        if done == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with Workers(problem.cases, 1) as pool, pytest.raises(KeyboardInterrupt):
        search(problem, study, pool, 12, stop)
    found = results(problem, study)
    assert len(found.trials) == 3
    assert not found.failed
    waiting = study.get_trials(states=(TrialState.WAITING,))
    stopped = study.get_trials(states=(TrialState.FAIL,))
    assert len(waiting) == len(stopped) == 5
    search(problem, study, workers, 12)
    found = results(problem, study)
    assert len(found.trials) == 12
    assert not found.failed
    tried = [trial.point for trial in found.trials]
    assert all(trial.params in tried for trial in stopped)
    assert not study.get_trials(states=(TrialState.RUNNING, TrialState.WAITING))


def test_trials_of_a_process_that_died_are_done_again(workers, storage):
    problem = short_problem()
    study = open_study(problem, storage, "tune")
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    distributions = {item.name: searching._distribution(item) for item in problem.space}
    for owner in (searching._owner(dead.pid), searching._owner(os.getppid()), "elsewhere:1"):
        study.ask(distributions).set_user_attr(searching.OWNER, owner)
    search(problem, study, workers, 4)
    # The two that may still live count as under way.
    assert len(results(problem, study).trials) == 2
    states = [trial.state for trial in study.get_trials()][:3]
    assert states == [TrialState.FAIL, TrialState.RUNNING, TrialState.RUNNING]
    done = results(problem, study).trials[0]
    assert done.point == study.get_trials()[0].params


def test_a_study_of_something_else_is_refused(workers, storage):
    problem = short_problem()
    study = open_study(problem, storage, "tune")
    assert open_study(problem, storage, "tune").user_attrs == study.user_attrs
    with pytest.raises(UserError, match="--study tune: .* with other objectives; choose"):
        open_study(short_problem(objectives=("delay",)), storage, "tune")
    with pytest.raises(UserError, match="other ranges"):
        open_study(short_problem(["deletion_misses=2:9"]), storage, "tune")
    with pytest.raises(UserError, match="other parameters"):
        open_study(short_problem(gate_probability=0.9), storage, "tune")


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("no_folder/a.journal", "does not exist"),
        ("study", "allowed is a file NAME.journal"),
        ("sqlite:////no/such/folder/study.db", "cannot be opened"),
        ("nonsense://x", "cannot be opened"),
    ],
)
def test_storages_that_cannot_be_opened(url, reason):
    with pytest.raises(UserError, match=reason):
        open_storage(url)


def test_searches_side_by_side_share_the_trials(tmp_path):
    """Two commands on one database, as on two machines: together they do what was asked for."""
    url = f"sqlite:///{tmp_path / 'study.db'}"
    problem = short_problem()
    open_study(problem, open_storage(url), "tune")

    def take_part():
        storage = open_storage(url)
        with Workers(problem.cases, 1) as pool:
            search(problem, open_study(problem, storage, "tune"), pool, 16)

    threads = [threading.Thread(target=take_part) for _ in range(2)]
    for thread in threads:
        thread.start()
        time.sleep(0.2)
    for thread in threads:
        thread.join()
    study = optuna.load_study(study_name="tune", storage=url)
    found = results(problem, study)
    # Both may have begun a batch before either saw that of the other.
    assert 16 <= len(found.trials) <= 24
    assert not found.failed
    assert not study.get_trials(states=(TrialState.RUNNING, TrialState.WAITING))
