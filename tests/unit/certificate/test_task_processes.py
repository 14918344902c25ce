"""Tasks that forked processes do: every answer comes, and what fails is not taken for shown."""

from __future__ import annotations

import contextlib
import os
import signal
from concurrent.futures import BrokenExecutor

import pytest

from soter.certificate.format.errors import RejectedError
from soter.certificate.task_processes import TaskProcesses, UnderWay, can_fork
from soter.certificate.terms.terms import NotRecheckedError

pytestmark = pytest.mark.skipif(not can_fork(), reason="this system does not fork processes")


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_task_is_answered_once(workers: int) -> None:
    running = TaskProcesses(300, lambda k: f"{k * k}", workers)
    assert sorted(running.answers()) == [(k, f"{k * k}") for k in range(300)]
    assert list(running.answers()) == []


def test_tasks_see_what_there_was_when_they_began() -> None:
    seen = ["before"]
    running = TaskProcesses(3, lambda _: seen[0], 2)
    seen[0] = "after"
    assert {said for _, said in running.answers()} == {"before"}


def fails_at(k: int, error: BaseException) -> TaskProcesses:
    def answer(task: int) -> str:
        if task == k:
            raise error
        return ""

    return TaskProcesses(40, answer, 2)


@pytest.mark.parametrize("error", [RejectedError("no"), NotRecheckedError("no"), MemoryError("no")])
def test_what_a_task_raises_is_raised(error: Exception) -> None:
    with pytest.raises(type(error), match="no"):
        list(fails_at(17, error).answers())


def test_a_process_that_is_ended_shows_nothing() -> None:
    def answer(task: int) -> str:
        if task >= 20:
            os.kill(os.getpid(), signal.SIGKILL)
        return ""

    with pytest.raises(BrokenExecutor, match="ended"):
        list(TaskProcesses(40, answer, 2).answers())


def test_one_process_of_two_that_is_ended_leaves_its_task_unshown() -> None:
    def answer(task: int) -> str:
        if task == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        return ""

    with pytest.raises(BrokenExecutor, match="ended"):
        list(TaskProcesses(40, answer, 2).answers())


def test_an_interrupt_is_for_who_waits_not_for_those_who_work() -> None:
    def answer(task: int) -> str:
        if task == 7:
            os.kill(os.getpid(), signal.SIGINT)  # as a terminal sends it to all of them
        return str(task)

    assert len(list(TaskProcesses(20, answer, 2).answers())) == 20


def test_tasks_may_be_more_than_a_pipe_holds() -> None:
    assert len(list(TaskProcesses(50_000, lambda _: "", 2).answers())) == 50_000


def test_processes_end_when_nobody_waits() -> None:
    running = TaskProcesses(2, lambda _: str(signal.sigwait({signal.SIGUSR1})), 2)
    processes = [p.pid for p in running._processes]
    running.end()
    for pid in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    running.end()


# ---------------------------------------------------------------- one after the other


class Noted:
    """Work that notes what is done of it, and fails where it is told to."""

    def __init__(self, name: str, notes: list[str], *, fails: str = "") -> None:
        self.name, self.notes, self.fails = name, notes, fails

    def _do(self, what: str) -> None:
        self.notes.append(f"{self.name} {what}")
        if self.fails == what:
            raise RejectedError(self.name)

    def begin(self) -> None:
        self._do("begins")

    def finish(self) -> None:
        self._do("is finished")

    def end(self) -> None:
        self.notes.append(f"{self.name} ends")


def test_the_next_work_begins_before_the_last_is_finished() -> None:
    notes: list[str] = []
    with UnderWay() as under_way:
        under_way.afterwards(lambda: notes.append("at once"))
        for name in "ab":
            under_way.begin(Noted(name, notes))
            under_way.afterwards(lambda name=name: notes.append(f"after {name}"))  # type: ignore[misc]
    assert notes == [
        *("at once", "a begins", "b begins", "a is finished", "after a"),
        *("b is finished", "after b"),
    ]


@pytest.mark.parametrize(
    ("last", "what"), [("a", "is finished"), ("b", "begins"), ("b", "is finished")]
)
def test_what_fails_is_raised_and_nothing_of_it_is_done_afterwards(last: str, what: str) -> None:
    notes: list[str] = []

    def all_three() -> None:
        with UnderWay() as under_way:
            for name in "abc":
                under_way.begin(Noted(name, notes, fails=what if name == last else ""))
                under_way.afterwards(lambda name=name: notes.append(f"after {name}"))  # type: ignore[misc]

    with pytest.raises(RejectedError, match=last):
        all_three()
    assert f"after {last}" not in notes
    assert "c begins" not in notes or last == "b"
    assert "after c" not in notes


@pytest.mark.parametrize("what", ["begins", "is finished"])
def test_work_that_fails_has_another_way_of_its_own(what: str) -> None:
    """Not that of the one before."""
    notes: list[str] = []
    with UnderWay() as under_way:
        under_way.begin(Noted("a", notes), lambda: notes.append("a otherwise"))
        under_way.begin(Noted("b", notes, fails=what), lambda: notes.append("b otherwise"))
        under_way.afterwards(lambda: notes.append("after b"))
    assert notes.index("a is finished") < notes.index("b otherwise") < notes.index("after b")
    assert "a otherwise" not in notes


def test_another_way_that_fails_too_is_raised() -> None:
    def otherwise() -> None:
        raise NotRecheckedError("neither")

    with pytest.raises(NotRecheckedError, match="neither"), UnderWay() as under_way:
        under_way.begin(Noted("a", [], fails="is finished"), otherwise)


@pytest.mark.parametrize("what", ["begins", "is finished"])
def test_who_began_a_work_is_told_what_kept_it_from_being_shown(what: str) -> None:
    """And what comes behind it goes on; what is to be done after the work is not."""
    notes: list[str] = []
    with UnderWay() as under_way:
        for name in "abc":
            under_way.gave_up = lambda error, name=name: notes.append(f"{name}: {error}")  # type: ignore[misc]
            with contextlib.suppress(RejectedError):
                under_way.begin(Noted(name, notes, fails=what if name == "b" else ""))
                under_way.afterwards(lambda name=name: notes.append(f"after {name}"))  # type: ignore[misc]
    assert ("b: b" in notes) == (what == "is finished"), "who begins hears it at once"
    assert "after b" not in notes
    assert [n for n in notes if n.startswith("after")] == ["after a", "after c"]


def test_the_work_before_fails_for_itself() -> None:
    """What the next one has as another way is not tried for it."""
    notes: list[str] = []

    def both() -> None:
        with UnderWay() as under_way:
            under_way.begin(Noted("a", notes, fails="is finished"))
            under_way.begin(Noted("b", notes), lambda: notes.append("b otherwise"))

    with pytest.raises(RejectedError, match="a"):
        both()
    assert "b ends" in notes
    assert "b otherwise" not in notes


def test_an_error_elsewhere_ends_what_is_under_way() -> None:
    notes: list[str] = []

    def interrupted() -> None:
        with UnderWay() as under_way:
            under_way.begin(Noted("a", notes))
            raise KeyError

    with pytest.raises(KeyError):
        interrupted()
    assert notes == ["a begins", "a ends"]
