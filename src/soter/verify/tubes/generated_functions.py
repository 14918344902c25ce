"""The functions of generated Soter source, checked like any program, and called here.

Purpose: `functions_of` a text; `Caller`, which evaluates them as the interpreter does.
Non-goals: what stands in the text (`tube_check.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.check.step_cost import cost_of
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.typed import FunSymbol

NAME = "tubes.soter"


class TooLongError(Exception):
    """The loops of a text may take more operations than a step may."""


def functions_of(text: str) -> Mapping[str, FunSymbol]:
    """By name. The text is our own: any other error than `TooLongError` is a defect here."""
    checked = check_file(NAME, f"soter 1;\n{text}")
    if any(d.code == "T007" for d in checked.diagnostics.items):
        raise TooLongError
    assert checked.program is not None, checked.diagnostics
    assert not checked.diagnostics.has_errors, [str(d) for d in checked.diagnostics.items]
    return checked.program.funs


class Caller:
    """Calls functions without parameters of a system."""

    def __init__(self, text: str) -> None:
        self._functions = functions_of(text)
        self._evaluator = Evaluator({})

    def operations(self, name: str) -> int:
        """Of one call of a function of this name, at worst."""
        return cost_of(self._functions[name]).operations

    def holds(self, name: str, *arguments: Any) -> bool:  # noqa: ANN401 - values of the program
        """Whether a function of this name says so; one that faults does not."""
        return bool(self.value(name, *arguments))

    def value(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401 - values of the program
        """What a function of this name gives; None where it faults."""
        try:
            return self._evaluator.function(self._functions[name])(Environment(), arguments)
        except StepFault:
            return None
