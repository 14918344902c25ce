"""Run a compiler whose output, time and life are bounded.

Purpose: noise makes a compiler write gigabytes and macros make it work for ever; what its driver
has started ends with it, and all of it with this process, however that ends (POSIX).
Non-goals: which compiler, and what its words mean (`compiler.py`, `stack_bound.py`).
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

OUTPUT_MAX = 2**18
"""Bytes of a compiler's output that are read; one that writes more is ended."""
LOOK_S = 0.5
GROUP = (
    'exec 3<&0; "$@" 3<&- </dev/null & p=$!; '
    "{ read -r x; kill -KILL 0; } <&3 >/dev/null 2>&1 & exec 3<&- </dev/null; wait $p"
)
"""A shell leads the group: the command, and who ends the group when our end of a pipe is gone."""


@dataclass(frozen=True)
class CompilerOutput:
    """`code`: None where it was ended, and then `why`; `text`: what it wrote, errors included."""

    code: int | None
    text: str
    why: str = ""


def run_compiler(command: Sequence[str], work: Path, limit_s: float) -> CompilerOutput:
    """Run a command in `work` to its end, or to what it may."""
    if os.name != "posix":
        return _run_elsewhere(command, work, limit_s)
    led = ("/bin/sh", "-c", GROUP, "sh", *command)
    process = subprocess.Popen(
        led,
        cwd=work,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    _running.add(process.pid)
    try:
        said, why = _read(process, time.monotonic() + limit_s, limit_s)
        code = None if why else process.wait()
    finally:
        _end(process.pid)
        _running.discard(process.pid)
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            stream.close()
        process.wait()
    return CompilerOutput(code, said.decode("utf-8", "replace"), why)


_running: set[int] = set()
"""Groups of the compilers that run now, in whichever thread."""


def end_compilers() -> None:
    """End all that run, for a person who does not wait for them."""
    for group in tuple(_running):
        _end(group)


def _end(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _read(process: subprocess.Popen[bytes], end: float, limit_s: float) -> tuple[bytes, str]:
    """What it says, and why it is not heard any longer; "" where it is done."""
    assert process.stdout is not None
    said, source = bytearray(), process.stdout.fileno()
    while (left := end - time.monotonic()) > 0:
        if select.select([source], [], [], min(left, LOOK_S))[0]:
            part = os.read(source, 2**16)
            if not part:
                return bytes(said), ""
            said += part
            if len(said) > OUTPUT_MAX:
                why = f"the compiler was ended: it wrote more than {OUTPUT_MAX:,} bytes"
                return bytes(said), why
    return bytes(said), f"the compiler was ended after {limit_s:g} s"


def _run_elsewhere(command: Sequence[str], work: Path, limit_s: float) -> CompilerOutput:
    """Where there are no process groups: bounded in time alone."""
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=limit_s, cwd=work)
    except subprocess.TimeoutExpired:
        return CompilerOutput(None, "", f"the compiler was ended after {limit_s:g} s")
    return CompilerOutput(done.returncode, (done.stdout + done.stderr).decode("utf-8", "replace"))
