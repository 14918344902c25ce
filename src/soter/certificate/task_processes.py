"""Tasks that forked processes do while this one goes on.

Purpose: `TaskProcesses`: some processes that take tasks one after the other and tell what came of
each. They see what there was when they were forked; only answers come back. `UnderWay`: one piece
of work is with them while the next one is prepared.
Non-goals: what a task is (`case_check.py`). There is no thread: this process may fork again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import struct
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from multiprocessing.connection import wait
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Protocol

from soter.certificate.format.errors import RejectedError
from soter.certificate.terms.terms import NotRecheckedError
from soter.workers.child_process import end_with

if TYPE_CHECKING:
    from collections.abc import Iterator
    from multiprocessing.connection import Connection

    from typing_extensions import Self

NUMBER = struct.Struct("<i")
FAILURES = (RejectedError, NotRecheckedError)


def can_fork() -> bool:
    """Whether this system forks processes."""
    return "fork" in multiprocessing.get_all_start_methods()


class TaskProcesses:
    """Processes at work on the tasks 0, 1, ..., of which `answer` tells what came of it."""

    def __init__(self, tasks: int, answer: Callable[[int], str], workers: int) -> None:
        fork = multiprocessing.get_context("fork")
        # processes that were forked share where they are in an open file
        self._numbers = TemporaryFile(buffering=0)  # noqa: SIM115  until all is told
        self._numbers.write(b"".join(map(NUMBER.pack, range(tasks))))
        self._numbers.seek(0)
        self._left = tasks
        self._processes: list[Any] = []
        self._answers: list[Connection] = []
        for _ in range(workers):
            ours, theirs = fork.Pipe(duplex=False)
            given = self._numbers.fileno(), answer, theirs, os.getpid()
            process = fork.Process(target=_work, args=given)
            process.start()
            theirs.close()
            self._processes.append(process)
            self._answers.append(ours)

    def answers(self) -> Iterator[tuple[int, str]]:
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
                    self._left -= 1
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
        self._numbers.close()
        self._processes, self._answers = [], []


def _work(numbers: int, answer: Callable[[int], str], to: Connection, parent: int) -> None:
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who is interrupted ends this one
    while number := os.read(numbers, NUMBER.size):
        (k,) = NUMBER.unpack(number)
        try:
            to.send((k, answer(k)))
        except Exception as error:  # noqa: BLE001  whoever asked is told
            to.send((k, error))
            return


class Work(Protocol):
    """What is done in two parts, the second by other processes."""

    def begin(self) -> None:
        """What this process does; then others are at work."""

    def finish(self) -> None:
        """Wait for them."""

    def end(self) -> None:
        """Have them end."""


GaveUp = Callable[[Exception], None]


class UnderWay:
    """The work that other processes do while this one prepares the next."""

    def __init__(self) -> None:
        self._work: Work | None = None
        self._otherwise: Callable[[], None] | None = None
        self._afterwards: list[Callable[[], None]] = []
        self._gave_up: GaveUp | None = None
        self.gave_up: GaveUp | None = None
        """Told, of work that begins from now on, what kept it from being shown; None: raised.

        It raises what is not for it to hear.
        """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, raised: object, *_: object) -> None:
        try:
            if raised is None:
                self.finish()
        finally:
            self.end()

    def begin(self, work: Work, otherwise: Callable[[], None] | None = None) -> None:
        """Begin some work, and then finish what was under way.

        `otherwise` is what is done where a claim of this work fails; None: that is raised,
        RejectedError or NotRecheckedError, here or when it is finished.
        """
        try:
            work.begin()
        except FAILURES:
            if otherwise is None:
                raise
            self.finish()
            otherwise()
            return
        try:
            self.finish()
        except BaseException:
            work.end()
            raise
        self._work, self._otherwise, self._gave_up = work, otherwise, self.gave_up

    def finish(self) -> None:
        """Wait for what is under way, and do what is to be done then.

        RejectedError, NotRecheckedError where a claim fails and nothing else is to be tried.
        """
        work, otherwise, afterwards = self._work, self._otherwise, self._afterwards
        gave_up = self._gave_up
        self._work, self._otherwise, self._afterwards, self._gave_up = None, None, [], None
        try:
            if work is not None:
                try:
                    work.finish()
                except FAILURES:
                    if otherwise is None:
                        raise
                    otherwise()
            for then in afterwards:
                then()
        except Exception as error:
            if gave_up is None:
                raise
            gave_up(error)

    def afterwards(self, then: Callable[[], None]) -> None:
        """What is done when what is under way is finished; at once where nothing is."""
        self._afterwards.append(then)
        if self._work is None:
            self.finish()

    def end(self) -> None:
        """What still works is not waited for, and shows nothing."""
        if self._work is not None:
            self._work.end()
        self._work, self._otherwise, self._afterwards = None, None, []
