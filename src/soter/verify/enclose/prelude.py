"""Functions of the prelude that are enclosed as what they stand for.

Purpose: `sin` becomes an enclosure of the sine, widened by the tested bound of
`language/prelude/function_error_bounds.py`, instead of an enclosure of its polynomial.
Non-goals: the other functions of the prelude, whose bodies are enclosed as they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.prelude.function_error_bounds import BOUNDS
from soter.verify.enclose.c_emitter import float_literal
from soter.verify.enclose.enclosed_values import Form

if TYPE_CHECKING:
    from soter.core import core
    from soter.verify.enclose.enclosed_operations import EnclosureOperations
    from soter.verify.enclose.enclosed_values import Item

ENCLOSED = frozenset(
    "sin cos tan exp log tanh atan asin acos atan2 hypot pow".split()  # noqa: SIM905 - a list of words
)
"""What `soter_n_NAME` of verify/engine/soter_form_math.h encloses."""

OF_A_TURN = frozenset({"sin", "cos", "tan", "wrap_angle"})
"""Functions of a full turn: a turn further they are the same."""


def is_prelude(function: core.Function) -> bool:
    """Whether a function is the prelude's (a program may call its own function `sin`)."""
    return function.span.source.name.startswith("<prelude>/")


def enclosed_call(
    ops: EnclosureOperations, function: core.Function, arguments: tuple[Item, ...]
) -> Item | None:
    """An enclosure of the function it stands for; None: enclose its body."""
    name = function.source_name
    if is_prelude(function) and name in OF_A_TURN:
        (angle,) = arguments
        if isinstance(angle, Form) and angle.turns:
            return _of_any_turn(ops, name, angle)
    if name not in ENCLOSED or not is_prelude(function):
        return None
    bound = BOUNDS[name]
    assert not bound.relative
    assert not bound.absolute
    operands = tuple(ops.form(a) for a in arguments)
    return Form(ops.emitter.emit("form", f"soter_n_{name}", *operands, float_literal(bound.ulps)))


def _of_any_turn(ops: EnclosureOperations, name: str, angle: Form) -> Item:
    """The same of an angle that may be any number of turns further."""
    bound, near = BOUNDS[name], ops.any_turn(angle)
    off = bound.absolute if name == "wrap_angle" else bound.ulps
    return Form(ops.emitter.emit("form", f"soter_n_{name}", near, float_literal(off)))
