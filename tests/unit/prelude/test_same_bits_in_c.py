"""The compiled C and the reference interpreter compute the same bits with every function.

One node walks through a table of arguments, calls everything with them and keeps the results in its
locals, which are part of the trace. The bounds measured on the interpreter thus hold for the C.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from exact_functions import hard_angles, seeded  # type: ignore[import-not-found]
from soter_functions import SIGNATURES  # type: ignore[import-not-found]
from test_no_faults import SPECIAL  # type: ignore[import-not-found]

from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from soter.simulate.result import Run

PERIOD_NS = 10_000_000
SCALARS = ("x", "y", "z", "w")
VECTORS = {
    "float": SCALARS,
    "Vec2": ("vec2(x, y)", "vec2(z, x)"),
    "Vec3": ("vec3(x, y, z)", "vec3(z, w, x)"),
    "Quat": ("quat(w, x, y, z)", "quat(y, x, w, z)"),
}


def _table() -> list[float]:
    rng = seeded("same bits")
    ordinary = [rng.choice((-1, 1)) * 10.0 ** rng.uniform(-9.0, 6.0) for _ in range(300)]
    wild = [rng.choice((-1, 1)) * 10.0 ** rng.uniform(-320.0, 308.0) for _ in range(100)]
    return [*SPECIAL, *ordinary, *wild, *hard_angles()[::20]]


def _literal(x: float) -> str:
    if math.isnan(x):
        return "sqrt(-1.0)"
    if math.isinf(x):
        return "1.0e308 * 10.0" if x > 0 else "-1.0e308 * 10.0"
    return repr(x)


def _program() -> str:
    table = _table()
    count = len(table)
    results, calls = [], []
    for name, (types, result) in SIGNATURES.items():
        taken = dict.fromkeys(VECTORS, 0)
        arguments = []
        for t in types:
            arguments.append(VECTORS[t][taken[t]])
            taken[t] += 1
        results.append(f"  var r_{name}: {result};")
        calls.append(f"    r_{name} = {name}({', '.join(arguments)});")
    return "\n".join(
        [
            "soter 1;",
            f"const TABLE: float[{count}] = [{', '.join(map(_literal, table))}];",
            "topic done: int in [0, 1000000] = 0;",
            f"node Probe period {PERIOD_NS}ns {{",
            "  publishes done;",
            "  var i: int;",
            *results,
            "  step {",
            f"    let x = TABLE[i % {count}];",
            f"    let y = TABLE[(i * 7 + 3) % {count}];",
            f"    let z = TABLE[(i * 13 + i / {count} + 5) % {count}];",
            f"    let w = TABLE[(i * 31 + 11) % {count}];",
            *calls,
            "    i = i + 1;",
            "    publish done = i;",
            "  }",
            "}",
            "system Probing default { node Probe; until 60s; }",
        ]
    )


@pytest.fixture(scope="module")
def runs() -> tuple[Run, Run]:
    """The same steps on both engines."""
    checked = check_file("probe.soter", _program())
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    system = system_of(checked, "Probing")
    until_ns = 2 * len(_table()) * PERIOD_NS
    native = NativeProgram(system).run(until_ns, 1, keep_trace=True)
    return native, run_interpreted(system, until_ns, 1, keep_trace=True)


def test_compiled_and_interpreted_results_agree_in_every_bit(
    runs: tuple[Run, Run],
) -> None:
    native, interpreted = runs
    assert native.trace is not None
    assert interpreted.trace is not None
    assert len(native.trace) == len(interpreted.trace) > 2 * len(_table())
    for name in SIGNATURES:
        ours = [t["Probe"][f"r_{name}"].tobytes() for t in native.trace]
        theirs = [t["Probe"][f"r_{name}"].tobytes() for t in interpreted.trace]
        first = next((k for k, (a, b) in enumerate(zip(ours, theirs, strict=True)) if a != b), None)
        assert first is None, f"{name} differs at step {first}"
    assert native.trace.tobytes() == interpreted.trace.tobytes()


def test_no_step_faults_in_c(runs: tuple[Run, Run]) -> None:
    native, _ = runs
    assert native.trace is not None
    assert native.violations == 0
    assert native.trace[-1]["topics"]["done"] == len(native.trace)
