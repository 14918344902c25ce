"""How an extern in Python is called, said where its author has taken it for something else.

Purpose: a function with another number of parameters, `inputs["motion"]`, a name that is not there:
the error as Python says it, and what this extern is called with and asked for, with types.
Non-goals: mistakes inside of the extern, which Python's own words and line tell best.
"""

from __future__ import annotations

import traceback
from types import FunctionType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.similar_names import closest
from soter.simulate.externs import process_state_guard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.types import Type

    Shapes = Sequence[tuple[str, Type]]

DEPTH = 3


def hint(error: Exception, step: object, arguments: Sequence[Any], shapes: Shapes) -> str:
    """What to write instead; "" where the error is none about the call. One line."""
    if isinstance(error, TypeError) and _not_entered(error):
        return f"{_called(step, arguments)}{_asked(shapes)}"
    (inputs, *_) = arguments or (None,)
    if not isinstance(inputs, SimpleNamespace):
        return ""
    if isinstance(error, TypeError) and "SimpleNamespace" in str(error):
        names = list(vars(inputs))
        return f"its inputs are attributes: `inputs.{names[0]}`" if names else ""
    of = getattr(error, "obj", None)
    if isinstance(error, AttributeError) and isinstance(of, SimpleNamespace):
        there = list(vars(of))
        near = closest(str(error.name), there, 0.6, 1)
        meant = f"is `{near[0]}` meant? " if near else ""
        return f"{meant}there {'is' if len(there) == 1 else 'are'} {_listed(there)}"
    return ""


def _not_entered(error: Exception) -> bool:
    """Whether the call itself failed: the last frame is the one that calls externs."""
    frames = list(traceback.walk_tb(error.__traceback__))
    return bool(frames) and frames[-1][0].f_code.co_filename == process_state_guard.__file__


def _called(step: object, arguments: Sequence[Any]) -> str:
    """With what: one argument with its attributes, or those of a function."""
    name = getattr(step, "__name__", "step")
    if len(arguments) != 1 or not isinstance(arguments[0], SimpleNamespace):
        given = ", ".join(_typed(a) for a in arguments)
        return f"it is called with {len(arguments)} arguments ({given})"
    own = isinstance(step, FunctionType)
    line = f"`def {name}(inputs):`" if own else f"`def {name}(self, inputs):`"
    if name == "<lambda>":
        line = "`lambda inputs: ...`"
    parts = [f"`inputs.{n}` {_typed(v)}" for n, v in vars(arguments[0]).items()]
    return f"write {line}; {', '.join(parts) or 'it has no inputs'}"


def _asked(shapes: Shapes) -> str:
    """The answer that is asked for."""
    if not shapes:
        return ""
    keys = ", ".join(f'"{name}": {t}' for name, t in shapes)
    return f"; it returns {{{keys}}}"


def _typed(value: object, depth: int = DEPTH) -> str:
    """The type of a value as Python's people say it, records with their fields."""
    if isinstance(value, SimpleNamespace):
        inner = ", ".join(f"{n}: {_typed(v, depth - 1)}" for n, v in vars(value).items())
        return f"with {inner}" if depth == DEPTH else f"({inner})" if depth else "(...)"
    name = f"array {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
    return f"({name})" if depth == DEPTH else name


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{n}`" for n in names)
