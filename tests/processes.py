"""Processes that tests start, and that end with the test.

Purpose: `run` and `started` put a process into a group of its own; whatever is left of the group
is killed when the test is done with it, also where it timed out or failed. No test rests on how
much of the clock a process needs: `TIMEOUT_S` ends what hangs, and nothing else is waited for than
what a process has done (`until`) or computed (`computed`).
Non-goals: processes that leave their group.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

PIPE = subprocess.PIPE
DEVNULL = subprocess.DEVNULL
STDOUT = subprocess.STDOUT
TimeoutExpired = subprocess.TimeoutExpired
Done = subprocess.CompletedProcess[Any]
Process = subprocess.Popen[Any]
TIMEOUT_S = 600.0
LOOK_S = 0.02


@contextmanager
def started(command: Sequence[str | Path], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """`subprocess.Popen`; its group is gone when the block is left.

    The environment is Python's: readline, which pytest loads, puts COLUMNS into that of C.
    """
    options.setdefault("env", dict(os.environ))
    process = subprocess.Popen(command, start_new_session=True, **options)
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream is not None:
                stream.close()


def run(
    command: Sequence[str | Path],
    *,
    timeout: float = TIMEOUT_S,
    check: bool = False,
    capture_output: bool = False,
    **options: Any,
) -> Done:
    """`subprocess.run`; raises `TimeoutExpired`, and with `check` `CalledProcessError`."""
    if capture_output:
        options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with started(command, **options) as process:
        out, err = process.communicate(timeout=timeout)
    done = subprocess.CompletedProcess(command, process.returncode, out, err)
    if check:
        done.check_returncode()
    return done


def until(done: Callable[[], object], process: Process) -> None:
    """Waits until something is so, while a process goes on."""
    end = time.monotonic() + TIMEOUT_S
    while not done():
        assert process.poll() is None, "it ended before"
        assert time.monotonic() < end, "it hangs"
        time.sleep(LOOK_S)


def computed(process: Process, seconds: float) -> None:
    """Waits until a process has had so much of the processors: it is at its work by then."""
    stat = Path(f"/proc/{process.pid}/stat")

    def done() -> bool:
        user, system = stat.read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK") >= seconds

    until(done, process)
