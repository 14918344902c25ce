"""Ctrl-C ends a question to a solver, and waits where the solver's own code is under way."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from soter.workers.interruptible_solver import ask_solver, ctrl_c_waits, raise_if_interrupted


class Interrupted:
    """A solver that thinks until it is told to stop; Ctrl-C comes meanwhile."""

    def __init__(self) -> None:
        self.told = threading.Event()
        self.swallows = True

    def set(self, name: str, value: object) -> None:
        assert (name, value) == ("ctrl_c", False), "z3's handler would swallow the signal"
        self.swallows = False

    def check(self) -> str:
        assert not self.swallows
        os.kill(os.getpid(), signal.SIGINT)
        self.told.wait()
        return "unknown"

    def interrupt(self) -> None:
        self.told.set()


class Failing(Interrupted):
    def check(self) -> str:
        raise ValueError("as it is")


def test_a_question_is_broken_off() -> None:
    solver = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        ask_solver(solver)
    assert solver.told.is_set()


def test_a_question_is_broken_off_where_the_signal_waits() -> None:
    solver = Interrupted()
    with pytest.raises(KeyboardInterrupt), ctrl_c_waits():
        ask_solver(solver)
    assert solver.told.is_set()


def test_what_a_question_raises_is_raised() -> None:
    with pytest.raises(ValueError, match="as it is"):
        ask_solver(Failing())


@ctrl_c_waits()
def signalled(times: int, reached: list[str]) -> None:
    for _ in range(times):
        signal.raise_signal(signal.SIGINT)
        reached.append("after the signal")
    raise_if_interrupted()
    reached.append("after a place where it is raised")


@ctrl_c_waits()
def signalled_at_the_end(reached: list[str]) -> None:
    signal.raise_signal(signal.SIGINT)
    reached.append("after the signal")


@pytest.mark.parametrize("times", [1, 2])
def test_the_first_signal_waits_for_a_place_and_a_second_does_not(times: int) -> None:
    reached: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        signalled(times, reached)
    assert reached == ["after the signal"]


def test_the_signal_is_raised_at_the_end_at_the_latest_and_once() -> None:
    reached: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        signalled_at_the_end(reached)
    assert reached == ["after the signal"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    raise_if_interrupted()


def test_who_handles_the_signal_already_goes_on() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    try:
        with ctrl_c_waits():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]
