"""What a proof over sets needs is compiled during a proof that has nothing compiled itself."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from processes import TIMEOUT_S
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.verify import command
from soter.verify.verify_module import ModuleMethod

if TYPE_CHECKING:
    from collections.abc import Callable

FIRST, SECOND = "Planner", "Guard"
PROBLEMS: Any = [
    SimpleNamespace(name=name, view="", influences=(), above=None, below=())
    for name in (FIRST, SECOND)
]


def proofs(
    monkeypatch: pytest.MonkeyPatch,
    prove: dict[str, Callable[[object], None]],
    compiled: dict[str, Callable[[Any], object] | None],
) -> None:
    """Two modules: what is compiled for each, and what is done with it in place of a proof."""

    def method(problem: Any) -> ModuleMethod:
        def verify(problem: Any, *, compiled: object, **_: object) -> Any:
            prove[problem.name](compiled)
            return SimpleNamespace(findings={})

        unused: Any = None
        return ModuleMethod(verify, unused, unused, compiled[problem.name])

    monkeypatch.setattr(command, "module_method", method)
    command._verify_problems(PROBLEMS, False, None, None, {})


def test_it_is_compiled_meanwhile_and_handed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    proving, compiling = threading.Event(), threading.Event()
    got: list[object] = []

    def first(compiled: object) -> None:
        assert compiled is None
        proving.set()
        assert compiling.wait(TIMEOUT_S), "nothing is compiled during the first proof"

    def compile_second(problem: Any) -> str:
        compiling.set()
        assert proving.wait(TIMEOUT_S)
        return f"code of {problem.name}"

    proofs(monkeypatch, {FIRST: first, SECOND: got.append}, {FIRST: None, SECOND: compile_second})
    assert got == [f"code of {SECOND}"]


def test_one_thing_is_compiled_at_a_time_in_the_order_of_the_proofs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What two modules have in common is found in the cache by the second."""
    said: list[str] = []

    def compile_slowly(problem: Any) -> str:
        said.append(f"begin {problem.name}")
        threading.Event().wait(0.05)
        said.append(f"end {problem.name}")
        return str(problem.name)

    def nothing(_: object) -> None:
        pass

    modules = (FIRST, SECOND)
    proofs(monkeypatch, dict.fromkeys(modules, nothing), dict.fromkeys(modules, compile_slowly))
    assert said == [f"{what} {name}" for name in modules for what in ("begin", "end")]


def test_what_cannot_be_compiled_is_said_in_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    proved: list[object] = []

    def refused(_: object) -> None:
        raise SoterError((Diagnostic("R007", "cannot be enclosed"),))

    with pytest.raises(SoterError, match="R007"):
        proofs(
            monkeypatch,
            {FIRST: proved.append, SECOND: proved.append},
            {FIRST: None, SECOND: refused},
        )
    assert proved == [None]
