"""No test leaves a process behind."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from subprocess import TimeoutExpired

import pytest

import processes

TESTS = Path(__file__).resolve().parents[1]
GRANDCHILD = "import os, time; os.fork(); time.sleep(600)"


def test_what_a_process_started_ends_with_it() -> None:
    read, write = os.pipe()
    with pytest.raises(TimeoutExpired):
        processes.run([sys.executable, "-c", GRANDCHILD], timeout=1, pass_fds=[write])
    os.close(write)
    assert os.read(read, 1) == b"", "nobody holds the other end"
    os.close(read)


def test_every_test_starts_its_processes_so() -> None:
    own = {TESTS / "processes.py", TESTS / "compatibility" / "make_corpus.py", Path(__file__)}
    paths = [
        p for p in TESTS.rglob("*.py") if p not in own and "import subprocess" in p.read_text()
    ]
    assert paths == []


ASKS = "import signal; print(*[signal.getsignal(n) == signal.SIG_IGN for n in (1, 2)])"
BELOW = f"""
import sys
import conftest, processes
processes.run([sys.executable, "-c", {ASKS!r}])
"""


def test_what_a_test_starts_hears_signals_where_tests_run_in_the_background() -> None:
    """A shell has its background jobs ignore Ctrl-C, `nohup` a hang-up, and all processes below."""
    ignoring = ["sh", "-c", 'trap "" HUP INT; exec "$@"', "sh", sys.executable, "-c"]
    told = [
        processes.run([*ignoring, code], capture_output=True, text=True, check=True, cwd=TESTS)
        for code in (ASKS, BELOW)
    ]
    assert [done.stdout.split() for done in told] == [["True", "True"], ["False", "False"]]


def test_what_hangs_is_ended_after_one_time_that_is_long_enough_anywhere() -> None:
    """Ten minutes: a minute of a test's own is what a busy machine needs now and then."""
    own = {TESTS / "processes.py", TESTS / "compatibility" / "make_corpus.py", Path(__file__)}
    timeouts = re.compile(
        r"\btimeout=\d|process\.wait\(\d|wait_for\([^)]*, \d|PATIENCE_S = \d|monotonic\(\) \+ \d"
    )
    paths = [p for p in TESTS.rglob("*.py") if p not in own and timeouts.search(p.read_text())]
    assert paths == []
    assert processes.TIMEOUT_S >= 600.0
