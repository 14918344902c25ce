"""Processes that others leave behind: they come to one process here, which ends them.

Purpose: no process that code started outlives the command, in whatever session it is. Linux; see
prctl(2), PR_SET_CHILD_SUBREAPER. Elsewhere `adopt_orphans` does nothing.
Non-goals: processes that mean harm: they may send this one signals.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
CLOSED_TO = 65_536
PATIENCE_S = 5.0
"""How long what is ended may take, s."""


def let_go_on(child: int) -> None:
    """Have a child that was stopped go on: code of an extern may send its parents signals.

    Where a person stops the command (Ctrl-Z), whoever would ask here stands still as well.
    """
    if sys.platform != "win32":
        with suppress(ChildProcessError, ProcessLookupError):
            if os.waitid(os.P_PID, child, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None:
                os.kill(child, signal.SIGCONT)


def adopt_orphans() -> None:
    """Have what descendants of this process leave behind become its children."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def end_children() -> None:
    """End the children of this process, and theirs, which come to it then."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end and (left := children_of(os.getpid())):
        for process in left:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
            with suppress(ChildProcessError):
                os.waitpid(process, 0)


def children_of(parent: int) -> list[int]:
    """The processes that a process has as children; proc(5)."""
    children = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(stat.read_bytes().rpartition(b")")[2].split()[1]) == parent:
                children.append(int(stat.parent.name))
    return children


def stay_between(parent: int) -> int:
    """Fork, and return in the child alone: the number of this process, which never returns.

    It leads a session, adopts what the child leaves behind, and ends all of it when the child has
    ended, when `parent` is gone, or on SIGTERM; then it ends as the child did.
    """
    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, (signal.SIGTERM, signal.SIGCHLD))
    adopt_orphans()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os._exit(1)
    own = os.getpid()
    child = os.fork()
    if child == 0:
        return own
    os.closerange(3, CLOSED_TO)
    code = _exit_code(child)
    end_children()
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with suppress(OSError):  # SIGKILL has no handler
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        os.kill(own, -code)
    os._exit(code if code >= 0 else 1)


def _exit_code(child: int) -> int:
    """Of a child, as `subprocess` has it; -9 where this process is to end before."""
    while signal.sigwait((signal.SIGTERM, signal.SIGCHLD)) == signal.SIGCHLD:
        with suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                if ended[0] == child:
                    return os.waitstatus_to_exitcode(ended[1])
    return -signal.SIGKILL
