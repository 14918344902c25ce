"""Tasks that forked processes do: every answer comes, and what fails is not taken for shown."""

from __future__ import annotations

import os
import signal
from concurrent.futures import BrokenExecutor

import pytest

from soter.certificate.case_check import TaskProcesses, can_fork
from soter.certificate.report import NotRecheckedError, RejectedError

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
    running.end_processes()
    for pid in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    running.end_processes()
