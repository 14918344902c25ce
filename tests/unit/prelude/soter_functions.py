"""The prelude's functions as Python callables, run by the reference evaluator.

`soter_function("sin")(0.5)` is what a Soter program computes for `sin(0.5)`; vectors come and go as
tuples of floats. A step fault is raised as `StepFault`.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Value

SIGNATURES: dict[str, tuple[tuple[str, ...], str]] = {
    **dict.fromkeys(("sign", "radians", "degrees", "wrap_angle"), (("float",), "float")),
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan"), (("float",), "float")),
    **dict.fromkeys(("exp", "log", "tanh"), (("float",), "float")),
    **dict.fromkeys(("atan2", "pow", "hypot"), (("float", "float"), "float")),
    **dict.fromkeys(("clamp", "lerp", "smoothstep"), (("float", "float", "float"), "float")),
    "vec2": (("float", "float"), "Vec2"),
    "vec3": (("float", "float", "float"), "Vec3"),
    "quat": (("float", "float", "float", "float"), "Quat"),
    "cross": (("Vec3", "Vec3"), "Vec3"),
    "unit": (("Vec3", "Vec3"), "Vec3"),
    "unit2": (("Vec2", "Vec2"), "Vec2"),
    "quat_mul": (("Quat", "Quat"), "Quat"),
    "quat_conj": (("Quat",), "Quat"),
    "quat_normalize": (("Quat",), "Quat"),
    "quat_rotate": (("Quat", "Vec3"), "Vec3"),
    "quat_rotate_inverse": (("Quat", "Vec3"), "Vec3"),
}
"""Every public function: the types of its parameters and of its result."""

SIZES = {"float": 1, "Vec2": 2, "Vec3": 3, "Quat": 4}

SCALARS = tuple(n for n, (_, result) in SIGNATURES.items() if result == "float")
VECTORS = tuple(n for n, (_, result) in SIGNATURES.items() if result != "float")


def program_text() -> str:
    """A program that calls every function once."""
    lines = ["soter 1;"]
    for name, (types, result) in SIGNATURES.items():
        parameters = ", ".join(f"p{i}: {t}" for i, t in enumerate(types))
        arguments = ", ".join(f"p{i}" for i in range(len(types)))
        lines.append(f"fun call_{name}({parameters}): {result} {{ return {name}({arguments}); }}")
    return "\n".join(lines)


@cache
def _compiled() -> dict[str, Callable[..., Value]]:
    checked = check_file("prelude_functions.soter", program_text())
    assert checked.program is not None
    assert not checked.diagnostics.items, [d.message for d in checked.diagnostics.items]
    evaluator = Evaluator({})

    def callable_of(name: str) -> Callable[..., Value]:
        assert checked.program is not None
        body = evaluator.closure_of(checked.program.funs[f"call_{name}"])
        environment = Environment()
        return lambda *arguments: body(environment, arguments)

    return {name: callable_of(name) for name in SIGNATURES}


def soter_function(name: str) -> Callable[..., Value]:
    """The function of that name, as every Soter program has it."""
    return _compiled()[name]


def flat_call(name: str, flat: tuple[float, ...]) -> tuple[float, ...]:
    """The function on its components in a row, and the components of its result."""
    types, result = SIGNATURES[name]
    arguments: list[object] = []
    rest = flat
    for t in types:
        part, rest = rest[: SIZES[t]], rest[SIZES[t] :]
        arguments.append(part[0] if t == "float" else part)
    assert not rest
    value = soter_function(name)(*arguments)
    return (value,) if result == "float" else value


def components(name: str) -> int:
    """How many floats the function takes in all."""
    return sum(SIZES[t] for t in SIGNATURES[name][0])
