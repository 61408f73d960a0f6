"""The executor of the nodes, with every kind of entity."""

from __future__ import annotations

import time

import pytest
import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from gda_tracker.nodes.executor import LeanExecutor

pytestmark = pytest.mark.nodes
TIMEOUT_S = 20.0


class Bench:
    """Two nodes on one executor."""

    def __init__(self, domain):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.executor = LeanExecutor(context=self.context)
        self.one, self.other = (Node(name, context=self.context) for name in ("one", "other"))
        self.executor.add_node(self.one)
        self.executor.add_node(self.other)

    def __enter__(self):
        return self

    def until(self, done):
        deadline = time.monotonic() + TIMEOUT_S
        while not done():
            assert time.monotonic() < deadline, "nothing came"
            self.executor.spin_once(timeout_sec=0.1)

    def __exit__(self, *_):
        self.executor.shutdown()
        for node in (self.one, self.other):
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def bench(domain):
    with Bench(domain) as made:
        yield made


def steady():
    return Clock(clock_type=ClockType.STEADY_TIME)


def test_messages_arrive_in_order_with_and_without_their_particulars(bench):
    got, informed = [], []
    bench.one.create_subscription(String, "words", lambda m: got.append(m.data), 100)
    bench.one.create_subscription(
        String, "words", lambda m, info: informed.append((m.data, info["source_timestamp"])), 100
    )
    publisher = bench.other.create_publisher(String, "words", 100)
    bench.until(lambda: publisher.get_subscription_count() == 2)
    words = [str(i) for i in range(50)]
    for word in words:
        publisher.publish(String(data=word))
    bench.until(lambda: len(got) == len(informed) == 50)
    assert got == [word for word, _ in informed] == words
    assert all(stamp > 0 for _, stamp in informed)


def test_services_clients_and_what_follows_them(bench):
    def answer(_, response):
        response.success, response.message = True, "done"
        return response

    bench.one.create_service(Trigger, "act", answer)
    client = bench.other.create_client(Trigger, "act")
    bench.until(client.service_is_ready)
    followed = []
    future = client.call_async(Trigger.Request())
    future.add_done_callback(lambda f: followed.append(f.result().message))
    bench.until(lambda: followed)
    assert followed == ["done"]


def test_tasks_and_guard_conditions(bench):
    done = []
    guard = GuardCondition(lambda: done.append("guard"), None, context=bench.context)
    guard.callback_group = bench.one.default_callback_group
    bench.one.default_callback_group.add_entity(guard)
    guard._executor_event = False
    bench.one._guards.append(guard)
    bench.executor.wake()
    guard.trigger()
    bench.executor.create_task(lambda: done.append("task"))
    bench.until(lambda: len(done) == 2)
    assert sorted(done) == ["guard", "task"]
    bench.one._guards.remove(guard)
    guard.destroy()


def test_timers_keep_their_period_and_stop_when_cancelled(bench):
    ticks = []
    timer = bench.one.create_timer(0.02, lambda: ticks.append(time.monotonic()), clock=steady())
    began = time.monotonic()
    bench.until(lambda: len(ticks) >= 5)
    assert time.monotonic() - began >= 4 * 0.02
    timer.cancel()
    bench.executor.spin_once(timeout_sec=0.0)
    count = len(ticks)
    for _ in range(5):
        bench.executor.spin_once(timeout_sec=0.02)
    assert len(ticks) == count


def test_it_returns_after_the_time_out_and_at_once_without_time(bench):
    for timeout, least in ((0.2, 0.15), (0.0, 0.0)):
        for _ in range(20):  # let what start-up brought be done
            bench.executor.spin_once(timeout_sec=0.05)
        began = time.monotonic()
        bench.executor.spin_once(timeout_sec=timeout)
        assert least <= time.monotonic() - began < TIMEOUT_S


def test_entities_that_come_and_go_in_callbacks(bench):
    """A timer destroys a subscription and another timer that are ready in the same round."""
    got, late = [], []
    publisher = bench.other.create_publisher(String, "words", 10)
    doomed = bench.one.create_subscription(String, "words", lambda m: got.append(m.data), 10)
    bench.until(lambda: publisher.get_subscription_count() == 1)

    def act():
        first.cancel()
        bench.one.destroy_subscription(doomed)
        bench.one.destroy_timer(second)
        bench.one.create_subscription(String, "words", lambda m: late.append(m.data), 10)

    first = bench.one.create_timer(0.01, act, clock=steady())
    second = bench.one.create_timer(0.01, lambda: got.append("timer"), clock=steady())
    publisher.publish(String(data="lost"))
    time.sleep(0.05)  # both timers and, if it is quick, the message are ready in one wait
    bench.executor.spin_once(timeout_sec=1.0)
    assert got == []
    bench.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="kept"))
    bench.until(lambda: late)
    assert late[-1] == "kept"
    assert got == []


def test_a_node_that_was_removed_is_left_alone(bench):
    ticks = []
    bench.other.create_timer(0.01, lambda: ticks.append(1), clock=steady())
    bench.until(lambda: ticks)
    bench.executor.remove_node(bench.other)
    count = len(ticks)
    for _ in range(5):
        bench.executor.spin_once(timeout_sec=0.02)
    assert len(ticks) == count


@pytest.mark.parametrize("kind", ["timer", "subscription", "service", "task"])
def test_errors_of_callbacks_reach_the_caller(bench, kind):
    def fail(*_):
        raise ZeroDivisionError(kind)

    if kind == "timer":
        bench.one.create_timer(0.01, fail, clock=steady())
    elif kind == "subscription":
        bench.one.create_subscription(String, "words", fail, 10)
        publisher = bench.other.create_publisher(String, "words", 10)
        bench.until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(String(data="word"))
    elif kind == "service":
        bench.one.create_service(Trigger, "act", fail)
        client = bench.other.create_client(Trigger, "act")
        bench.until(client.service_is_ready)
        client.call_async(Trigger.Request())
    else:
        bench.executor.create_task(fail)
    with pytest.raises(ZeroDivisionError, match=kind):
        bench.until(lambda: False)


def test_a_shut_down_context_ends_the_wait(bench):
    bench.one.create_timer(0.05, lambda: rclpy.try_shutdown(context=bench.context), clock=steady())
    with pytest.raises(ExternalShutdownException):
        bench.until(lambda: False)
    with pytest.raises(ExternalShutdownException):  # and the next time
        bench.executor.spin_once(timeout_sec=0.1)


def test_after_its_own_shutdown_nothing_happens(bench):
    ticks = []
    bench.one.create_timer(0.01, lambda: ticks.append(1), clock=steady())
    bench.executor.shutdown()
    bench.executor.spin_once(timeout_sec=0.1)
    assert not ticks
