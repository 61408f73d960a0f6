"""Inputs that hear nothing although somebody publishes are subscribed anew, and nothing is lost."""

from __future__ import annotations

from graph_helpers import TIMEOUT_S
from std_msgs.msg import String

from gda_tracker.nodes.base import RingNode
from gda_tracker.nodes.hearing import FIRST_WAIT_S, MOST_RENEWALS, Hearing
from gda_tracker.nodes.qualities import stream
from gda_tracker.nodes.runner import Nodes
from gda_tracker.nodes.scan_source import ScanSourceParameters


class Subscriptions:
    """Stands for a node: which subscriptions live, and who publishes."""

    def __init__(self, publishers=()):
        self.living, self.received = [], []
        self.publishers = frozenset(publishers)
        self.hearing = Hearing(
            self._create, self.living.remove, self.received.append, lambda: self.publishers
        )

    def _create(self, callback):
        self.living.append([callback])
        return self.living[-1]

    def deliver(self, message, to):
        self.living[to][0](message)


def renewals(subscriptions, until):
    return [t for t in range(until) if subscriptions.hearing.check(float(t))]


def test_without_a_publisher_nothing_is_renewed():
    assert renewals(Subscriptions(), 1000) == []


def test_waits_double_and_end():
    times = renewals(Subscriptions([b"a"]), 1000)
    waits = [FIRST_WAIT_S * 2**i for i in range(MOST_RENEWALS)]
    assert times == [sum(waits[: i + 1]) for i in range(MOST_RENEWALS)]


def test_a_new_publisher_begins_it_again():
    s = Subscriptions([b"a"])
    assert len(renewals(s, 1000)) == MOST_RENEWALS
    s.publishers = frozenset([b"b"])
    assert len([t for t in range(1000, 2000) if s.hearing.check(float(t))]) == MOST_RENEWALS


def test_the_one_that_hears_is_kept_and_the_others_say_nothing():
    for hears in (0, 1):
        s = Subscriptions([b"a"])
        assert renewals(s, 5) == [3]
        assert len(s.living) == 2
        kept = s.living[hears]
        s.deliver("first", hears)
        s.deliver("first", 1 - hears)
        assert s.received == ["first"]
        assert not s.hearing.check(6.0)
        assert s.living == [kept]
        s.deliver("second", 0)
        assert s.received == ["first", "second"]
        assert renewals(s, 1000) == []
        s.hearing.close()
        assert s.living == []


def test_closed_before_anything_came():
    s = Subscriptions([b"a"])
    renewals(s, 5)
    s.hearing.close()
    assert s.living == []


class Listening(RingNode):
    def __init__(self, **options):
        super().__init__("listening", ScanSourceParameters, **options)
        self.received = []

    def open_topics(self):
        self.subscribe(String, "text", lambda m: self.received.append(m.data), stream(), True)


class Talking(RingNode):
    def __init__(self, **options):
        super().__init__("talking", ScanSourceParameters, **options)

    def open_topics(self):
        self.text = self.advertise(String, "text", stream())


def test_over_dds_a_late_word_is_heard_once(domain):
    with Nodes(lambda **o: [Listening(**o), Talking(**o)], domain) as nodes:
        listening, talking = nodes.nodes
        assert nodes.spin_until(lambda: listening.counters["renewed_subscription"] == 1, TIMEOUT_S)
        both = [s for s in listening.subscriptions if s.topic_name == "/text"]
        assert len(both) == 2
        # Both are matched: each of them hears every word.
        assert nodes.spin_until(lambda: talking.text.get_subscription_count() == 2, TIMEOUT_S)
        words = [str(i) for i in range(20)]
        for word in words:
            talking.text.publish(String(data=word))
        assert nodes.spin_until(
            lambda: len([s for s in listening.subscriptions if s.topic_name == "/text"]) == 1,
            TIMEOUT_S,
        )
        talking.text.publish(String(data="end"))
        assert nodes.spin_until(lambda: "end" in listening.received, TIMEOUT_S)
        assert listening.received == [*words, "end"]
