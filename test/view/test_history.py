"""The history: bounded, numbered, safe for several threads."""

from __future__ import annotations

import threading

from gda_tracker.view.history import History


def pictures(gda, n):
    all_of_them = [picture for _, picture in gda.history.between(1, 999)]
    return [all_of_them[i % len(all_of_them)] for i in range(n)]


def test_numbers_go_on_when_the_oldest_go(gda):
    history = History(scans=5)
    assert (history.first, history.newest) == (0, 0)
    shown = pictures(gda, 12)
    assert [history.add(picture) for picture in shown] == list(range(1, 13))
    assert (history.first, history.newest) == (8, 12)
    assert [n for n, _ in history.between(1, 99)] == [8, 9, 10, 11, 12]
    assert history.between(9, 10) == [(9, shown[8]), (10, shown[9])]
    assert history.between(1, 7) == []
    assert history.between(13, 20) == []


def test_memory_is_bounded_and_the_newest_always_stays(gda):
    shown = pictures(gda, 10)
    size = max(picture.size_bytes for picture in shown)
    history = History(scans=100, most_bytes=3 * size)
    for picture in shown:
        history.add(picture)
        kept = [p.size_bytes for _, p in history.between(1, 99)]
        assert sum(kept) <= 3 * size
    assert history.first > 1
    tiny = History(scans=100, most_bytes=1)
    for picture in shown:
        tiny.add(picture)
    assert tiny.first == tiny.newest == 10


def test_seconds_count_from_the_first_scan_even_when_it_is_gone(gda):
    history = History(scans=2)
    shown = pictures(gda, 6)
    for picture in shown:
        history.add(picture)
    assert history.seconds(shown[5]) == (shown[5].stamp_ns - shown[0].stamp_ns) * 1e-9


def test_a_new_beginning_has_another_generation(gda):
    history = History()
    history.add(pictures(gda, 1)[0])
    before, version = history.generation, history.version
    history.clear()
    assert history.generation == before + 1
    assert history.version > version
    assert history.between(1, 9) == []
    assert history.add(pictures(gda, 1)[0]) == 1


def test_listeners_hear_every_change_and_nothing_is_lost_between_threads(gda):
    history, heard = History(scans=50), []
    history.listen(lambda: heard.append(history.version))
    shown = pictures(gda, 40)

    def add():
        for picture in shown:
            history.add(picture)
            history.notice("said")

    threads = [threading.Thread(target=add) for _ in range(3)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        numbers = [n for n, _ in history.between(1, 999)]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) if numbers else True
    for thread in threads:
        thread.join()
    assert history.newest == 120
    assert len(heard) == 240
    assert [n.number for n in history.notices()] == list(range(71, 121))
