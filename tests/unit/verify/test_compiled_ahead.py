"""What a proof over sets needs is compiled during a proof that has nothing compiled itself."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.front_end import check_file
from soter.verify import module_methods
from soter.verify.command import verify
from soter.verify.module_methods import ModuleMethod
from unit.verify.test_asked import CART, TWO

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 60.0
FIRST, SECOND = "r[0].Guard", "r[1].Guard"


class ProofError(Exception):
    """No proof is made in these tests: it ends here."""


def proofs(
    monkeypatch: pytest.MonkeyPatch,
    *,
    first: Callable[[], None],
    second: Callable[[], None],
    compiled: dict[str, Callable[[Any], object] | None],
) -> None:
    """Two modules, of which only this is done; `compiled` is what each has compiled."""

    def method(problem: Any) -> ModuleMethod:
        def prove(problem: Any, **_: object) -> Any:
            (first if problem.name == FIRST else second)()

        unused: Any = None
        return ModuleMethod(prove, unused, unused, compiled[problem.name])

    monkeypatch.setattr(module_methods, "module_method", method)
    checked = check_file("two.soter", CART + TWO)
    verify(checked, system="Two")


def over() -> None:
    raise ProofError


def test_it_is_compiled_meanwhile_and_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    proving, compiling, made = threading.Event(), threading.Event(), threading.Event()

    def first() -> None:
        proving.set()
        assert compiling.wait(PATIENCE_S), "nothing is compiled during the first proof"

    def compile_second(problem: Any) -> None:
        assert problem.name == SECOND
        compiling.set()
        assert proving.wait(PATIENCE_S)
        threading.Event().wait(0.2)  # longer than the first proof takes
        made.set()

    def second() -> None:
        assert made.is_set(), "the second proof would compile it once more"
        over()

    with pytest.raises(ProofError):
        proofs(
            monkeypatch,
            first=first,
            second=second,
            compiled={FIRST: None, SECOND: compile_second},
        )


def test_what_cannot_be_compiled_is_said_by_the_proof_that_needs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proved: list[str] = []

    def refused(_: object) -> None:
        raise SoterError((Diagnostic("R007", "cannot be enclosed"),))

    def second() -> None:
        assert proved == ["first"]
        over()

    with pytest.raises(ProofError):
        proofs(
            monkeypatch,
            first=lambda: proved.append("first"),
            second=second,
            compiled={FIRST: None, SECOND: refused},
        )


def test_nothing_is_compiled_beside_a_proof_that_compiles_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[object] = []
    with pytest.raises(ProofError):
        proofs(
            monkeypatch,
            first=lambda: None,
            second=over,
            compiled=dict.fromkeys((FIRST, SECOND), asked.append),
        )
    assert not asked
