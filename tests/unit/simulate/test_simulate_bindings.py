"""Which name means which extern, and who overrides whom."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.native.extern_bindings import bind
from soter.simulate.externs.callables import load_callables
from soter.simulate.interrupt import StopRequest
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.language.model.system import System

    Flat = Callable[..., System]

TEXT = """
soter 1;
topic pos: float;
topic u: float in [-1.0, 1.0];
plant Point period 10ms { reads u; drives pos = x; state x: float; der x = u; }
extern node Learned period 20ms from "python:policy.py:step" { subscribes pos; publishes u; }
node Stay period 20ms { subscribes pos; publishes u; step { publish u = 0.0; } }
rta Guard { ac Learned; sc Stay; period 100ms; safe true; ttf false; safer true; }
system One { p: Point; module Guard; until 1s; }
system Two { left: One; right: One; until 1s; }
"""


def constant(value: float) -> Callable[[Any], float]:
    return lambda _: value


def names(system: System, given: dict[str, object]) -> dict[str, object]:
    return {x.name: x.bound for x in bind(system, given).externs}


def test_the_program_says_what_answers(flat: Flat) -> None:
    assert names(flat(TEXT, "One"), {}) == {"Guard.Learned": "python:policy.py:step"}


@pytest.mark.parametrize("name", ["Guard.Learned", "Learned"])
def test_an_extern_goes_by_several_names(flat: Flat, name: str) -> None:
    f = constant(0.0)
    assert names(flat(TEXT, "One"), {name: f}) == {"Guard.Learned": f}


def test_one_name_may_mean_several_and_the_full_one_wins(flat: Flat) -> None:
    f, g = constant(0.0), constant(1.0)
    for given in (
        {"Learned": f, "right.Guard.Learned": g},
        {"right.Guard.Learned": g, "Learned": f},
    ):
        bindings = names(flat(TEXT, "Two"), dict(given))
        assert bindings == {"left.Guard.Learned": f, "right.Guard.Learned": g}


def test_a_class_is_made_once_for_each_instance(flat: Flat) -> None:
    made = []

    class Policy:
        def __init__(self) -> None:
            made.append(self)

        def step(self, _: object) -> float:
            return 0.0

    load_callables(bind(flat(TEXT, "Two"), {"Learned": Policy}), "native", StopRequest())
    assert len(made) == 2


def test_what_cannot_be_called_is_refused(flat: Flat) -> None:
    with pytest.raises(SoterError) as caught:
        load_callables(bind(flat(TEXT, "One"), {"Learned": 3}), "native", StopRequest())
    assert caught.value.diagnostics[0].code == "X002"


def test_a_binding_to_c_reaches_the_generated_program(flat: Flat, tmp_path: Path) -> None:
    file = tmp_path / "p.c"
    file.write_text(
        '#include "test.h"\n'
        "int go(const test_Guard_Learned_in *in, test_Guard_Learned_out *out) {\n"
        "  out->u = in->pos < 0.3 ? 0.5 : -0.25; out->has_u = 1; return in->pos > 0.32; }\n"
    )
    bindings = bind(flat(TEXT, "One"), {"Learned": f"c:{file}:go"})
    system = bindings.system
    assert load_callables(bindings, "native", StopRequest()) == {}
    native = NativeProgram(system, core=bindings.core).run(10**9, 1, hash_trace=True)
    bound = load_callables(bindings, "interp", StopRequest())
    interpreted = run_interpreted(system, 10**9, 1, bound)
    assert native.trace_sha256 == interpreted.trace_sha256
    assert native.final["p"]["x"] > 0.2


TYPES = """
soter 1;
type Kind = enum { SLOW, FAST };
type Vec = { a: float, n: int in [0, 200] };
input topic vec: Vec in { a in [-1.0, 1.0], n in [0, 200] };
input topic kind: Kind;
input topic flags: bool[3];
input topic few: float[<=3] = [1.0, 2.0];
topic out: Vec in { a in [-9.0, 9.0], n in [0, 200] };
topic mode: Kind;
topic sum: float[2] in [-99.0, 99.0];
extern node E period 10ms { subscribes flags, vec, kind, few; publishes mode, out, sum; }
system S { node E; input vec every 20ms; input kind every 10ms; input flags every 30ms; until 1s; }
"""
TYPES_C = """
#include "test.h"
int step(const test_E_in *in, test_E_out *out) {
  out->mode = in->kind;
  out->has_mode = in->flags.at[1];
  out->out.a = in->vec.a * 2.0 + in->few.items[1];
  out->out.n = (uint8_t)(in->vec.n + (in->flags.at[0] ? 1 : 0));
  out->has_out = 1;
  out->sum.at[0] = (double)in->few.len;
  out->sum.at[1] = in->flags.at[2] ? -0.0 : 1.0;
  out->has_sum = 1;
  return 0;
}
"""


def in_python(inputs: Any) -> dict[str, object]:
    outputs: dict[str, object] = {
        "out": (inputs.vec.a * 2.0 + inputs.few[1], inputs.vec.n + (1 if inputs.flags[0] else 0)),
        "sum": [float(len(inputs.few)), -0.0 if inputs.flags[2] else 1.0],
    }
    if inputs.flags[1]:
        outputs["mode"] = inputs.kind
    return outputs


def test_every_type_crosses_to_c_and_back(flat: Flat, tmp_path: Path) -> None:
    file = tmp_path / "e.c"
    file.write_text(TYPES_C)
    hashes = set()
    for target in (in_python, f"c:{file}:step"):
        bindings = bind(flat(TYPES), {"E": target})
        bound = load_callables(bindings, "native", StopRequest())
        program = NativeProgram(bindings.system, core=bindings.core)
        hashes.add(program.run(10**9, 1, bound, hash_trace=True).trace_sha256)
        bound = load_callables(bindings, "interp", StopRequest())
        hashes.add(run_interpreted(bindings.system, 10**9, 1, bound).trace_sha256)
    assert len(hashes) == 1


LOCALS = """
soter 1;
topic u: float in [-9.0, 9.0];
extern node E period 10ms { publishes u; var n: int; }
system S { node E; until 1s; }
"""


def test_locals_of_a_c_node_are_for_the_native_engine(flat: Flat, tmp_path: Path) -> None:
    file = tmp_path / "e.c"
    file.write_text(
        '#include "test.h"\n'
        "int step(const test_E_in *in, test_E_local *local, test_E_out *out) {\n"
        "  (void)in; local->n++; out->u = (double)(local->n % 5); out->has_u = 1; return 0; }\n"
    )
    bindings = bind(flat(LOCALS), {"E": f"c:{file}:step"})
    run = NativeProgram(bindings.system, core=bindings.core).run(10**9, 1)
    assert run.final["E"]["n"] == 101
    with pytest.raises(SoterError) as caught:
        load_callables(bindings, "interp", StopRequest())
    assert caught.value.diagnostics[0].code == "X008"


def test_a_package_of_functions_is_only_asked_for_what_is_called(flat: Flat) -> None:
    text = """
    soter 1;
    extern fun never(x: float): float from "python:nowhere.py:f";
    topic u: float;
    node N period 10ms { publishes u; step { publish u = 1.0; } }
    system S { node N; until 100ms; }
    """
    assert bind(flat(text), {}).externs == []
