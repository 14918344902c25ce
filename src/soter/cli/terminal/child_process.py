"""A command in a process of its own, where code runs that is nobody's in particular.

Purpose: a command that runs externs ends with the exit code that a parent saw, in which no extern
runs. The child does the command and leaves its words and exit code in a file without a name
(`ResultPipe` of `console.py`); the parent passes signals on, waits, and tells what it finds there.
Where it finds nothing that is X011, never success, however the child ended. What externs have
started ends with the run, and the child with its parent.
Non-goals: isolation. Externs run in the child with all its rights: one that means to may find the
file, write a verdict of its own, or change the engine's memory. That takes `workers/`.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from typing import TYPE_CHECKING

from soter.cli.terminal.console import ResultPipe
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.workers.child_process import adopt_orphans, end_children, end_with, let_go_on

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.cli.terminal.console import Console

    Rescue = Callable[[int], tuple[str, ...]]

PATIENCE_S = 5
"""How long a child that was told to end may take, s: it may be in C that hears nothing."""
AGAIN_S = 1.0
"""A second signal that comes later than this is a person's who will not wait."""


def in_child_process(console: Console, rescue: Rescue) -> None:
    """Go on in a child, where this process is a command of its own; the parent does not come back.

    It raises `Elsewhere` with the child's verdict; without one `SoterError` X011, or
    `KeyboardInterrupt` where the child had been told to end. `rescue(pid)` then saves what files
    the child was about to write, and says so, a sentence each.
    """
    if not console.own_process or not hasattr(os, "fork"):
        return
    verdict = ResultPipe()
    console.flush()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    ending = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    ending = {s for s in ending if signal.getsignal(s) is not signal.SIG_IGN}
    parent = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*ending, signal.SIGCHLD, signal.SIGALRM})
    child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        end_with(parent)
        verdict.begin()
        console.leave_to(verdict)
        return
    adopt_orphans()
    status, told = _wait(child, {*ending, signal.SIGCHLD, signal.SIGALRM})
    end_children()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    exception = verdict.found()
    if exception is not None:
        raise exception
    saved = rescue(child)
    if told:
        for text in saved:
            console.note(text)
        raise KeyboardInterrupt
    raise SoterError((_without_verdict(status, saved),))


def _wait(child: int, signals: set[signal.Signals]) -> tuple[int, bool]:
    """The child's wait status, and whether a signal had told it to end."""
    told_s: float | None = None
    while True:
        number, passed_on = _next(signals)
        if number == signal.SIGCHLD:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                signal.alarm(0)
                return status, told_s is not None
            let_go_on(child)
        elif number == signal.SIGALRM or (told_s and time.monotonic() - told_s > AGAIN_S):
            os.kill(child, signal.SIGKILL)
        else:
            told_s = told_s or time.monotonic()
            if not passed_on:
                os.kill(child, number)
            if number != signal.SIGINT:
                signal.alarm(PATIENCE_S)


def _next(signals: set[signal.Signals]) -> tuple[int, bool]:
    """The next signal; whether the terminal gave it to the child, too."""
    if sys.platform == "linux":
        info = signal.sigwaitinfo(signals)
        return info.si_signo, info.si_code > 0
    return signal.sigwait(signals), False


def _without_verdict(status: int, saved: tuple[str, ...]) -> Diagnostic:
    code = os.waitstatus_to_exitcode(status)
    how = f"it ended by itself, with exit status {code}"
    if code < 0:
        how = f"it was ended by {signal.Signals(-code).name}"
    return Diagnostic(
        "X011",
        "the process in which the externs ran is gone, without a verdict",
        notes=(how, *saved),
        helps=("an extern ends it by `os._exit`, `os.exec*`, a crash in linked C, or a signal",),
    )
