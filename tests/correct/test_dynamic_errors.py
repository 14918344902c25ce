"""Every program in tests/dynamic_error goes wrong at run time as it says, on both engines alike.

A file says what to expect in its first lines: `// expect: fault COMPONENT KIND`,
`latched COMPONENT`, `violations N`, `topic NAME = VALUE`, `gate_faults MODULE`, `switches MODULE`,
`mode MODULE SC|AC`,
`property "TEXT" ONSETS`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import soter
from generators.file_listing import files_in
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted
from tables import all_rows

if TYPE_CHECKING:
    from soter.simulate.result import Run

FOLDER = Path(__file__).resolve().parents[1] / "dynamic_error"
FILES = files_in(FOLDER, "*.soter")
DEFAULT_NS = 1_000_000_000


def _component(run: Run, name: str) -> Any:
    return run.final["components"][run.system.component(name).index]


def _module(run: Run, name: str) -> Any:
    index = next(m.index for m in run.system.modules if m.name == name)
    return run.final["modules"][index]


def _holds(run: Run, expectation: str) -> None:
    kind, _, rest = expectation.partition(" ")
    words = rest.split()
    if kind == "fault":
        row = _component(run, words[0])
        assert row["faults"] > 0
        assert FaultKind(int(row["last_fault"])).name.lower() == words[1]
    elif kind == "latched":
        assert _component(run, words[0])["latched"] == 1
    elif kind == "violations":
        assert run.violations == int(words[0])
    elif kind == "topic":
        name, value = (x.strip() for x in rest.split("="))
        assert float(run.final["topics"][name]) == float(value)
    elif kind == "gate_faults":
        assert run.modules[words[0]].gate_faults > 0
    elif kind == "switches":
        assert run.modules[words[0]].switches_to_sc > 0
    elif kind == "mode":
        assert _module(run, words[0])["mode"] == (words[1] == "AC")
    elif kind == "property":
        match = re.fullmatch(r'"(.*)" (\d+)', rest)
        assert match
        counts = {v.what: v.count for v in run.violation_list}
        assert counts[match.group(1)] == int(match.group(2))
    else:
        pytest.fail(f"unknown expectation: {expectation}")


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_a_program_goes_wrong_at_run_time_as_it_says(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    expectations = re.findall(r"^// expect: (.*)$", text, re.MULTILINE)
    assert expectations
    checked = check_file(str(path))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    system = system_of(checked, None)
    until_ns = system.until_ns or DEFAULT_NS
    native = NativeProgram(system).run(until_ns, 1, hash_trace=True)
    interpreted = run_interpreted(system, until_ns, 1)
    for run in (native, interpreted):
        for expectation in expectations:
            _holds(run, expectation)
    assert native.trace_sha256 == interpreted.trace_sha256


def test_every_kind_of_step_fault_has_a_program() -> None:
    fault = re.compile(r"^// expect: fault \S+ (\w+)$", re.MULTILINE)
    named = {kind for p in FILES for kind in fault.findall(p.read_text(encoding="utf-8"))}
    # an extern's is a driver's matter, and what a shield refuses is computed first (test_shield.py)
    kinds = {k.name.lower() for k in FaultKind} - {"none", "extern", "shield"}
    assert kinds <= named


MODULE = """soter 1;
topic u: float in [-1.0, 1.0];
topic x: float;
extern node Wild period 10ms { subscribes x; publishes u; }
node Calm period 10ms {
  subscribes x;
  publishes u;
  step { publish u = clamp(-x, -1.0, 1.0); }
}
rta M { ac Wild; sc Calm; period 20ms; safe abs(x) < 5.0; ttf abs(x) > 4.0; safer abs(x) < 3.0; }
plant P period 10ms { reads u; drives x = s; state s: float; der s = u; }
system S { p: P; module M; until 1s; always abs(p.truth.s) < 5.0; }
"""


class _Boom(BaseException):
    pass


class _Raises:
    def __init__(self, error: type[BaseException]) -> None:
        self.error = error

    def __float__(self) -> float:
        raise self.error


class _Counts:
    """Answers differently each time it is asked."""

    asked = 0

    def __float__(self) -> float:
        _Counts.asked += 1
        return (_Counts.asked % 7) / 10


def _raising(error: type[BaseException]) -> object:
    def step(_inputs: object) -> float:
        raise error

    return step


HOSTILE = {
    **{e.__name__: _raising(e) for e in (ValueError, _Boom, SystemExit, KeyboardInterrupt)},
    **{
        f"{e.__name__} in __float__": (lambda _, e=e: _Raises(e))
        for e in (ValueError, _Boom, SystemExit, KeyboardInterrupt)
    },
    "a list": lambda _: [1.0, 2.0],
    "NaN": lambda _: float("nan"),
    "infinity": lambda _: float("inf"),
    "outside": lambda _: 1.5,
    "huge": lambda _: 10**400,
    "text": lambda _: "0.5",
}


@all_rows("name", HOSTILE)
def test_whatever_a_python_controller_does_is_a_gate_fault_on_both_engines(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / "m.soter"
    path.write_text(MODULE)
    hashes = set()
    for engine in ("native", "interp"):
        program = soter.load(path).bind("Wild", HOSTILE[name])
        run = program.simulate(seed=1, engine=engine, trace=False)
        assert run.violations == 0
        assert run.modules["M"].gate_faults > 0
        assert _module(run, "M")["mode"] == 0
        hashes.add(run.trace_sha256)
    assert len(hashes) == 1


def test_an_answer_is_read_once_on_both_engines(tmp_path: Path) -> None:
    path = tmp_path / "m.soter"
    path.write_text(MODULE)
    hashes = set()
    for engine in ("native", "interp"):
        _Counts.asked = 0
        program = soter.load(path).bind("Wild", lambda _: _Counts())
        hashes.add(program.simulate(seed=1, engine=engine, trace=False).trace_sha256)
    assert len(hashes) == 1
