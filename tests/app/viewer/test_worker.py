"""The latest request wins, nothing waits, nothing is lost that matters."""

import threading
import time

import pytest

from deformer_app.viewer.worker import SolverThread
from waiting import HANG, wait_for


@pytest.fixture
def threads():
    """Make threads; they are ended afterwards."""
    made = []

    def make(answer, **options):
        made.append(SolverThread(answer, **options))
        return made[-1]

    yield make
    for thread in made:
        assert thread.close(HANG)


def test_only_the_newest_request_is_answered_after_a_slow_one(threads):
    begun, gate, served = threading.Event(), threading.Event(), []

    def answer(request):
        served.append(request)
        begun.set()
        gate.wait(HANG)
        yield request

    thread = threads(answer)
    thread.ask(0)
    assert begun.wait(HANG)
    for n in range(1, 1000):
        thread.ask(n)
    assert served == [0] and not gate.is_set(), "asking waited for the solver"
    gate.set()
    wait_for(lambda: len(served) == 2)
    wait_for(lambda: thread.newest() == 999)
    assert served == [0, 999]
    assert thread.newest() is None
    wait_for(lambda: not thread.busy)


def test_improving_an_answer_stops_for_a_newer_request(threads):
    given, first = [], threading.Event()

    def answer(request):
        for step in range(100_000):
            given.append((request, step))
            first.set()
            time.sleep(0.0005)
            yield request, step
            if request == "new" and step == 3:
                return

    thread = threads(answer)
    thread.ask("old")
    assert first.wait(HANG)
    thread.ask("new")
    before = len(given)
    wait_for(lambda: thread.newest() == ("new", 3))
    after = [request for request, _ in given[before:]]
    assert after.count("old") <= 1, "only the step under way was ended"


def test_a_failure_is_told_and_the_next_request_is_served(threads):
    def answer(request):
        yield 1 / request

    thread = threads(answer)
    thread.ask(0)
    told = []
    wait_for(lambda: told.extend(thread.failures()) or told)
    (failure,) = told
    assert failure.request == 0 and isinstance(failure.error, ZeroDivisionError)
    assert thread.failures() == []
    thread.ask(4)
    wait_for(lambda: thread.newest() == 0.25)


def test_it_says_when_there_is_something(threads):
    told = threading.Event()
    thread = threads(lambda request: iter([request]), notify=told.set)
    thread.ask(1)
    assert told.wait(HANG)
    assert thread.newest() == 1


def test_closing_ends_what_would_go_on_for_ever(threads):
    def answer(request):
        while True:
            yield request

    thread = threads(answer)
    thread.ask(1)
    wait_for(lambda: thread.newest() is not None)
