"""Soter functions as Python callables.

Purpose: `python_function` lets tests, tables and figures call a program's own functions, in the
reference evaluator.
Non-goals: speed; externs (a call of one faults).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.model.values import from_python, to_python

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.typed import FunSymbol, TypedProgram


def python_function(program: TypedProgram, fun: FunSymbol) -> Callable[..., Any]:
    """A callable for `fun`, with every parameter of the program at its default."""
    basic = Evaluator({})
    evaluator = Evaluator({p: basic.value(p.default) for p in program.params.values()})
    compiled = evaluator.function(fun)

    def call(*arguments: object) -> Any:  # noqa: ANN401 - any Soter value
        if len(arguments) != len(fun.parameters):
            msg = f"{fun.name} takes {len(fun.parameters)} arguments, not {len(arguments)}"
            raise TypeError(msg)
        values = tuple(
            from_python(p.type, a, p.name) for p, a in zip(fun.parameters, arguments, strict=True)
        )
        return to_python(fun.result, compiled(Environment(), values))

    call.__name__ = fun.name
    return call
