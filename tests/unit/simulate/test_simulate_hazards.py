"""What an extern in Python may do to the process, and what the run makes of it."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.native.extern_bindings import bind
from soter.simulate.externs.callables import load_callables
from soter.simulate.interrupt import StopRequest
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System
    from soter.simulate.result import Run

    Flat = Callable[..., System]

TEXT = """
soter 1;
topic u: float in [-1.0, 1.0];
extern node Learned period 20ms { publishes u; }
node Stay period 20ms { publishes u; step { publish u = 0.0; } }
rta Guard { ac Learned; sc Stay; period 100ms; safe true; ttf false; safer true; }
system S { module Guard; until 1s; }
"""
STEPS = 51


def run(flat: Flat, target: object, engine: str) -> Run:
    bindings = bind(flat(TEXT), {"Learned": target})
    bound = load_callables(bindings, engine, StopRequest())
    if engine == "native":
        program = NativeProgram(bindings.system, core=bindings.core)
        return program.run(10**9, 1, bound, hash_trace=True)
    return run_interpreted(bindings.system, 10**9, 1, bound)


def faults(done: Run) -> int:
    return int(done.final["components"]["faults"].sum())


class Unreadable(Exception):  # noqa: N818 - an extern's own
    def __str__(self) -> str:
        return str(sys.exit("no message"))


def colourful(_: object) -> float:
    raise ValueError("\x1b[31mred\x1b[2J\x07")


def unreadable(_: object) -> float:
    raise Unreadable


def badly_named(_: object) -> float:
    raise type("\x1b[31mRed", (Exception,), {})("words")


SAID = [
    (colourful, r"ValueError: \x1b[31mred\x1b[2J\x07"),
    (unreadable, "Unreadable: its message cannot be read"),
    (badly_named, r"\x1b[31mRed: words"),
]
engines = pytest.mark.parametrize("engine", ["native", "interp"])


@engines
@pytest.mark.parametrize(("target", "said"), SAID, ids=lambda x: getattr(x, "__name__", ""))
def test_an_exception_is_told_in_visible_characters(
    flat: Flat, target: Callable[[object], float], said: str, engine: str
) -> None:
    done = run(flat, target, engine)
    assert faults(done) == STEPS
    assert done.extern_failures["Guard.Learned"].startswith(said)


@engines
def test_a_lowered_limit_of_recursion_is_the_externs_own(flat: Flat, engine: str) -> None:
    before = sys.getrecursionlimit()

    def shallow(_: object) -> float:
        for limit in range(20, 1000):
            try:
                sys.setrecursionlimit(limit)
            except RecursionError:
                continue
            return 0.0
        return 1.0

    assert faults(run(flat, shallow, engine)) == 0
    assert sys.getrecursionlimit() == before


@engines
def test_a_raised_limit_of_recursion_stays_for_the_next_step(flat: Flat, engine: str) -> None:
    before = sys.getrecursionlimit()

    class Deep:
        def __init__(self) -> None:
            sys.setrecursionlimit(before + 5000)

        def step(self, _: object) -> float:
            return self.down(before + 200)

        def down(self, depth: int) -> float:
            return 0.5 if depth == 0 else self.down(depth - 1)

    assert faults(run(flat, Deep, engine)) == 0
    assert sys.getrecursionlimit() == before


@engines
def test_a_change_of_folder_is_the_externs_own(
    flat: Flat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, engine: str
) -> None:
    (tmp_path / "weights").mkdir()
    (tmp_path / "weights" / "w.txt").write_text("0.25")
    monkeypatch.chdir(tmp_path)

    class Moves:
        def __init__(self) -> None:
            os.chdir("weights")

        def step(self, _: object) -> float:
            return float(Path("w.txt").read_text())

    assert faults(run(flat, Moves, engine)) == 0
    assert Path.cwd() == tmp_path

    def home(_: Any) -> float:
        os.chdir(tmp_path)
        return 0.0

    run(flat, home, engine)


@engines
def test_a_copy_of_the_process_ends_with_the_step(
    flat: Flat, capfd: pytest.CaptureFixture[str], engine: str
) -> None:
    copies: list[int] = []

    def forks(_: object) -> float:
        if not copies:
            copies.append(os.fork())
        return 0.0

    assert faults(run(flat, forks, engine)) == 0
    _, status = os.waitpid(copies[0], 0)
    assert os.waitstatus_to_exitcode(status) == 1
    assert "the copy ends with the call" in capfd.readouterr().err
