"""The feed: every batch once, in order, made ahead, errors as they are, no thread left behind."""

import threading
import time

import pytest

from zeggs_jax.training.feed import Feed


def running() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == "batches"]


def test_batches_come_once_and_in_order():
    asked = []

    def make(k: int) -> int:
        asked.append(k)
        return 10 * k

    with Feed(make, 3, 9) as feed:
        assert [feed.take(k) for k in range(3, 9)] == [30, 40, 50, 60, 70, 80]
    assert asked == [3, 4, 5, 6, 7, 8]


def test_they_are_made_ahead_but_not_without_end():
    made = []
    with Feed(lambda k: made.append(k), 0, 100, depth=2) as feed:
        feed.take(0)
        deadline = time.monotonic() + 10.0
        while len(made) < 4 and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.1)
        assert made == [0, 1, 2, 3]  # one taken, two that lie ready, one in hand


def test_waiting_is_measured():
    with Feed(lambda k: time.sleep(0.2), 0, 2) as slow:
        slow.take(0)
        assert slow.waited > 0.1
    with Feed(lambda k: k, 0, 2) as quick:
        time.sleep(0.3)
        quick.take(0)
        assert quick.waited < 0.1


def test_an_error_comes_as_it_is_when_its_batch_is_due():
    problem = OSError("the disk is gone")

    def make(k: int) -> int:
        if k == 2:
            raise problem
        return k

    with Feed(make, 0, 5) as feed:
        assert [feed.take(0), feed.take(1)] == [0, 1]
        with pytest.raises(OSError, match="the disk is gone") as raised:
            feed.take(2)
    assert raised.value is problem
    assert running() == []


@pytest.mark.parametrize("taken", [0, 1, 5])
def test_no_thread_is_left_behind(taken):
    with Feed(lambda k: k, 0, 1000) as feed:
        for k in range(taken):
            feed.take(k)
    assert running() == []


def test_no_batches_are_no_thread_for_long():
    with Feed(lambda k: pytest.fail("no batch is needed"), 4, 4):
        pass
    assert running() == []


def test_batches_are_taken_in_order():
    with Feed(lambda k: k, 0, 5) as feed, pytest.raises(RuntimeError, match="batch 3 was asked for, batch 0 is next"):
        feed.take(3)
