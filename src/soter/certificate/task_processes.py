"""Tasks that forked processes do while this one goes on.

Purpose: `TaskProcesses`: some processes, among which tasks are dealt out, and which tell what came
of each. They see what there was when they were forked; only answers come back.
Non-goals: what a task is (`case_check.py`). There is no thread: this process may fork again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import BrokenExecutor
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any

from soter.workers.child_process import end_with

if TYPE_CHECKING:
    from collections.abc import Callable, Generator
    from multiprocessing.connection import Connection


def can_fork() -> bool:
    """Whether this system forks processes."""
    return "fork" in multiprocessing.get_all_start_methods()


class TaskProcesses:
    """Processes at work on the tasks 0, 1, ..., of which `answer` tells what came of it."""

    def __init__(self, tasks: int, answer: Callable[[int], str], workers: int) -> None:
        fork = multiprocessing.get_context("fork")
        self._left = set(range(tasks))
        self._processes: list[Any] = []
        self._answers: list[Connection] = []
        for first in range(workers):
            ours, theirs = fork.Pipe(duplex=False)
            given = range(first, tasks, workers), answer, theirs, os.getpid()
            process = fork.Process(target=_work, args=given)
            process.start()
            theirs.close()
            self._processes.append(process)
            self._answers.append(ours)

    def answers(self) -> Generator[tuple[int, str]]:
        """Tasks that are done, with their answers, as they come; what one raised is raised here.

        BrokenExecutor where a process ended before its time. Then, and when all is said, they end.
        """
        try:
            while self._left:
                ready = wait(self._answers)
                for side in [x for x in self._answers if x in ready]:
                    try:
                        number, said = side.recv()
                    except EOFError:
                        self._answers.remove(side)
                        continue
                    if isinstance(said, BaseException):
                        raise said
                    self._left.remove(number)
                    yield number, said
                if self._left and not self._answers:
                    raise BrokenExecutor("a process of the re-check was ended")
        finally:
            self.end()

    def end(self) -> None:
        """What still works is not waited for."""
        for process in self._processes:
            process.kill()
            process.join()
            process.close()
        for side in self._answers:
            side.close()
        self._processes, self._answers = [], []


def _work(tasks: range, answer: Callable[[int], str], to: Connection, parent: int) -> None:
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who is interrupted ends this one
    for k in tasks:
        try:
            to.send((k, answer(k)))
        except Exception as error:  # noqa: BLE001  whoever asked is told
            to.send((k, error))
            return
