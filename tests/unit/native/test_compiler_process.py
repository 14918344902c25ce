"""A compiler says no more than is read, and what it has started ends with it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

import processes
from soter.diagnostics.diagnostic import SoterError
from soter.native import compiler
from soter.native.compiler import OUTPUT_MAX, CompilerOutput, end_compilers, run_compiler

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="groups and /proc of Linux")
TALKS = "import sys\nwhile True: sys.stderr.write('error: no\\n' * 1000)\n"
LEAVES = "sleep 1000 & echo $! > left; wait"


def lives(file: Path) -> bool:
    """Whether the process whose number stands in a file is there, and no zombie."""
    with suppress(OSError, ValueError):
        stat = Path(f"/proc/{int(file.read_text())}/stat").read_text()
        return stat.rpartition(")")[2].split()[0] != "Z"
    return False


def test_what_it_says_is_bounded(tmp_path: Path) -> None:
    said = run_compiler([sys.executable, "-c", TALKS], tmp_path, 60.0)
    assert said.code is None
    assert "wrote more than" in said.why
    assert OUTPUT_MAX < len(said.text) < 2 * OUTPUT_MAX


def test_its_exit_code_and_words_are_told(tmp_path: Path) -> None:
    said = run_compiler(["sh", "-c", "echo one; echo two >&2; exit 3"], tmp_path, 60.0)
    assert (said.code, sorted(said.text.split()), said.why) == (3, ["one", "two"], "")


def test_what_it_started_ends_with_its_time(tmp_path: Path) -> None:
    said = run_compiler(["sh", "-c", LEAVES], tmp_path, 1.0)
    assert said.code is None
    assert "after 1 s" in said.why
    with processes.started(["sleep", "60"]) as waiting:
        processes.until(lambda: not lives(tmp_path / "left"), waiting)


def test_what_it_started_ends_with_us(tmp_path: Path) -> None:
    """Whoever runs the compiler is killed, and can end nothing itself."""
    (tmp_path / "asks.py").write_text(
        "from pathlib import Path\nfrom soter.native.compiler import run_compiler\n"
        f"run_compiler(['sh', '-c', {LEAVES!r}], Path('.'), 60.0)\n"
    )
    with processes.started([sys.executable, "asks.py"], cwd=tmp_path) as process:
        left = tmp_path / "left"
        processes.until(lambda: left.is_file() and left.read_text().endswith("\n"), process)
        assert lives(left)
        process.send_signal(signal.SIGKILL)
        process.wait()
        with processes.started(["sleep", "60"]) as waiting:
            processes.until(lambda: not lives(left), waiting)


def test_that_of_another_thread_ends_when_it_is_told_to(tmp_path: Path) -> None:
    outputs: list[CompilerOutput] = []

    def compile_long() -> None:
        outputs.append(run_compiler(["sh", "-c", LEAVES], tmp_path, 600.0))

    compiling = threading.Thread(target=compile_long, daemon=True)
    compiling.start()
    left = tmp_path / "left"
    with processes.started(["sleep", "60"]) as waiting:
        processes.until(lambda: left.is_file() and left.read_text().endswith("\n"), waiting)
        processes.until(lambda: compiler._running, waiting)  # it may have written before
        end_compilers()
        processes.until(lambda: not lives(left), waiting)
    compiling.join(processes.TIMEOUT_S)
    (output,) = outputs
    assert output.code != 0


@pytest.mark.parametrize("lines", [False, True])
def test_noise_in_the_place_of_c_is_told(tmp_path: Path, *, lines: bool) -> None:
    """A megabyte of noise took a compiler minutes, and gigabytes of words."""
    chance = Random(1)  # noqa: S311 - noise
    raw = chance.randbytes(2**20)
    text = bytes(10 if k % 60 == 0 else 32 + b % 95 for k, b in enumerate(raw)) if lines else raw
    (tmp_path / "noise.c").write_bytes(text)
    command = [*compiler.find_compiler().command, "-std=c99", "-c", "noise.c", "-o", os.devnull]
    with pytest.raises(SoterError) as caught:
        compiler.compile_with(command, tmp_path, "no", telling=("error",))
    (problem,) = caught.value.diagnostics
    assert problem.code == "X004"
    assert 2 <= len(problem.notes) <= compiler.LINES + 1
    assert "wrote more than" in problem.notes[-1]
    assert all(len(x) < 10 * compiler.LINE_MAX for x in problem.notes)
