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

from soter.program.arith import FaultKind
from soter.program.build import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from soter.simulate.run import Run

FOLDER = Path(__file__).resolve().parents[1] / "dynamic_error"
FILES = sorted(FOLDER.glob("*.soter"))
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
        found = re.fullmatch(r'"(.*)" (\d+)', rest)
        assert found
        counts = {v.what: v.count for v in run.violation_list}
        assert counts[found.group(1)] == int(found.group(2))
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
    kinds = {k.name.lower() for k in FaultKind} - {"none", "extern"}
    assert kinds <= named
