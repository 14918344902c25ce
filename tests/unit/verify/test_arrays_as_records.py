"""A robot of arrays is proved as the same robot of fields: axes, errors, sets and certificates."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import recheck
from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.front_end import check_file, system_of
from soter.language.syntax.printer import format_source
from soter.verify.problem.extract import extract
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.problem.problem import Problem

JOINTS = 2


@dataclass(frozen=True)
class Writing:
    """How the numbers of the joints are written down."""

    joints: str
    commands: str
    drives: str
    states: str
    rates: str
    act: str
    back: str
    of: str
    """A joint by its number, `{0}`."""


FIELDS = Writing(
    joints="{ q0: float, q1: float }",
    commands="{ u0: float, u1: float }",
    drives="{ q0: q0, q1: q1 }",
    states="state q0: float; state q1: float; "
    "disturbance e0: float in [-0.1, 0.1]; disturbance e1: float in [-0.1, 0.1];",
    rates="der q0 = speed.u0 + e0; der q1 = speed.u1 + e1;",
    act="{ u0: 1.0, u1: -1.0 }",
    back="{ u0: clamp(-4.0 * j.q0, -1.0, 1.0), u1: clamp(-4.0 * j.q1, -1.0, 1.0) }",
    of="j.q{0}",
)
ARRAYS = Writing(
    joints="{ q: float[2] }",
    commands="float[2]",
    drives="{ q: q }",
    states="state q: float[2]; disturbance e: float[2] in [-0.1, 0.1];",
    rates="der q = speed + e;",
    act="[1.0, -1.0]",
    back="saturate(-4.0 * j.q, 1.0)",
    of="j.q[{0}]",
)
JOINTS_OF_TWO = replace(
    ARRAYS,
    joints="{ q: float }[2]",
    drives="[{ q: q[0] }, { q: q[1] }]",
    back="[clamp(-4.0 * j[0].q, -1.0, 1.0), clamp(-4.0 * j[1].q, -1.0, 1.0)]",
    of="j[{0}].q",
)


def robot(w: Writing, axes: str = "") -> str:
    """The text; `axes` in place of the `grid` lines."""
    joints = [w.of.format(i) for i in range(JOINTS)]
    safe = " && ".join(f"abs({q}) < 1.0" for q in joints)
    lines = [f"grid {q} in [-1.0, 1.0] / 40;" for q in joints]
    errors = ", ".join(f"{q} within 0.001" for q in joints)
    return f"""soter 1;
const LAST: int = {JOINTS - 1};
topic j: {w.joints} max_age 10ms;
topic speed: {w.commands} in [-1.0, 1.0];
plant Slides period 4ms {{
  reads speed;
  drives j = {w.drives};
  {w.states}
  {w.rates}
  measured {errors};
}}
node Policy period 8ms {{ publishes speed; step {{ publish speed = {w.act}; }} }}
node Home period 8ms {{ subscribes j; publishes speed; step {{ publish speed = {w.back}; }} }}
rta Joints {{
  ac Policy; sc Home; period 16ms;
  safe {safe};
  verify {{ {axes or " ".join(lines)} }}
}}
system S default {{ a: Slides; module Joints; until 1s; }}
"""


def problem_of(text: str) -> Problem:
    flat = system_of(check_file("joints.soter", text), None)
    return extract(flat, flat.modules[0])


def sets_of(folder: Path) -> list[tuple[str, bytes]]:
    """Every file of sets in a certificate, by name."""
    return sorted((p.name, p.read_bytes()) for p in (folder / "sets").iterdir())


def test_the_same_joints_have_the_same_sets_and_certificates_that_are_accepted(
    tmp_path: Path,
) -> None:
    made = {}
    for name, writing in (("fields", FIELDS), ("arrays", ARRAYS), ("joints", JOINTS_OF_TWO)):
        (tmp_path / f"{name}.soter").write_text(robot(writing))
        report = soter.load(tmp_path / f"{name}.soter").verify(cert=tmp_path / name, refute=False)
        (module,) = report.modules
        assert module.verdict == "proved"
        said = {p: (f.verdict, f.text) for p, f in module.findings.items()}
        made[name] = said, module.shares, sets_of(tmp_path / name)
        answer = recheck(tmp_path / name)
        assert answer.accepted, answer.reason
    assert made["arrays"] == made["fields"]
    assert made["joints"] == made["fields"]


@pytest.mark.parametrize(
    ("writing", "axes", "named"),
    [
        (ARRAYS, "grid j.q[LAST] in [0.0, 1.0] / 2; grid j.q[LAST - 1] in [0.0, 1.0] / 2;", (1, 0)),
        (ARRAYS, "grid a.q[1] in [0.0, 1.0] / 2, j.q[0] in [0.0, 1.0] / 2;", (1, 0)),
        (JOINTS_OF_TWO, "grid j[LAST].q in [0.0, 1.0] / 2; grid a.q[0] in [0.0, 1.0] / 3;", (1, 0)),
    ],
)
def test_an_axis_is_the_element_that_it_names(
    writing: Writing, axes: str, named: tuple[int, ...]
) -> None:
    problem = problem_of(robot(writing, axes))
    declared = [a for g in problem.groups for a in g.axes]
    assert [a.state for a in declared] == list(named)
    assert [a.name for a in declared] == [f"a.q[{i}]" for i in named]


def test_two_names_of_one_element_are_one_state() -> None:
    text = robot(ARRAYS, "grid j.q[1] in [0.0, 1.0] / 2; grid a.q[LAST] in [0.0, 1.0] / 2;")
    with pytest.raises(soter.SoterError, match="R009"):
        problem_of(text)


def test_the_error_of_one_element_is_of_that_one_alone() -> None:
    text = robot(ARRAYS)
    wider = text.replace("j.q[1] within 0.001", "j.q[LAST] within 0.25")
    assert wider != text
    problem = problem_of(wider)
    names = [e.name for e in problem.quantities.errors]
    bounds = dict(zip(names, [e.high for e in problem.errors], strict=True))
    assert bounds == {"j.q[0]": 0.001, "j.q[1]": 0.25}


def test_what_is_advised_where_a_joint_has_no_bounds_can_be_written() -> None:
    with pytest.raises(soter.SoterError) as raised:
        problem_of(robot(ARRAYS, "grid j.q[0] in [-1.0, 1.0] / 20;"))
    (told,) = raised.value.diagnostics
    line = str(told.helps[-1]).partition("{ ")[2].partition(" }")[0]
    assert line == "grid a.q[1] in [low, high] / cells;"
    line = line.replace("low, high", "-1.0, 1.0").replace("cells", "100")
    problem_of(robot(ARRAYS, f"grid j.q[0] in [-1.0, 1.0] / 20; {line}"))


def test_a_certificate_calls_states_as_programs_do(tmp_path: Path) -> None:
    (tmp_path / "joints.soter").write_text(robot(ARRAYS))
    soter.load(tmp_path / "joints.soter").verify(cert=tmp_path / "cert", refute=False)
    manifest = (tmp_path / "cert" / "manifest.json").read_text()
    assert '"a.q[1]"' in manifest
    assert ".[" not in manifest


@pytest.mark.parametrize(
    ("line", "shown"),
    [("grid j . q [ 1 ] in [ 0, 1 ] / 2;", "grid j.q[1] in [0, 1] / 2;")],
)
def test_axes_of_elements_are_laid_out(line: str, shown: str) -> None:
    text = format_source(Source("joints.soter", robot(ARRAYS, line)), Diagnostics())
    assert text is not None
    assert shown in text


@pytest.mark.parametrize("writing", [FIELDS, ARRAYS, JOINTS_OF_TWO])
def test_a_run_of_arrays_is_judged_and_watched(tmp_path: Path, writing: Writing) -> None:
    (tmp_path / "joints.soter").write_text(robot(writing))
    program = soter.load(tmp_path / "joints.soter")
    (judged,) = program.monitor(seed=3)
    assert judged.alarms == 0
    assert 0.9 < judged.share <= 1.0
    program.emit_monitor(tmp_path / "watch.soter")
    watched = """soter 1;
import "joints.soter" as r;
import "watch.soter" as w;
system Watched { a: r.Slides; module r.Joints; node w.ModelMonitor; until 1s; never w.modelAlarm; }
"""
    (tmp_path / "watched.soter").write_text(watched)
    run = soter.load(tmp_path / "watched.soter").simulate()
    assert run.violations == 0


WRONG = {
    "SC reads the other joint": (ARRAYS.back, "saturate(-4.0 * [j.q[1], j.q[0]], 1.0)"),
    "commands move the other joint": ("speed + e", "[speed[1] + e[0], speed[0] + e[1]]"),
    "one error is large": ("j.q[1] within 0.001", "j.q[1] within 0.9"),
    "one disturbance is large": ("speed + e", "[speed[0] + e[0], speed[1] + 20.0 * e[1]]"),
}
OTHER = {
    "a smaller `safe` of one joint": ("abs(j.q[1]) < 1.0", "abs(j.q[1]) < 0.5"),
    "another range of one axis": ("j.q[1] in [-1.0", "j.q[1] in [-0.9"),
}


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_what_fails_for_one_element_is_not_proved(tmp_path: Path, change: tuple[str, str]) -> None:
    old, new = change
    text = robot(ARRAYS)
    assert old in text
    (tmp_path / "joints.soter").write_text(text.replace(old, new))
    (module,) = soter.load(tmp_path / "joints.soter").verify(refute=False).modules
    assert module.verdict == "undecided"


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("joints")
    (folder / "joints.soter").write_text(robot(ARRAYS))
    soter.load(folder / "joints.soter").verify(cert=folder / "cert", refute=False)
    return folder / "cert"


@pytest.mark.parametrize("change", [*WRONG.values(), *OTHER.values()], ids=[*WRONG, *OTHER])
def test_a_certificate_of_other_elements_is_refused(
    tmp_path: Path, certificate: Path, change: tuple[str, str]
) -> None:
    copied = tmp_path / "cert"
    shutil.copytree(certificate, copied)
    small_proofs.edit_program(copied, change)
    assert not recheck(copied).accepted


@pytest.mark.parametrize(
    ("writing", "names"),
    [
        (FIELDS, ("speed.u0", "speed.u1")),
        (ARRAYS, ("speed[0]", "speed[1]")),
        (JOINTS_OF_TWO, ("speed[0]", "speed[1]")),
        (replace(ARRAYS, rates="der q = [speed[0] + e[0], speed[1]];"), ("speed[0]", "speed[1]")),
    ],
)
def test_check_tells_of_a_shield_over_elements_that_two_commands_move(
    tmp_path: Path, writing: Writing, names: tuple[str, str]
) -> None:
    def warnings(axes: str) -> list[str]:
        text = robot(writing, axes).replace("period 16ms;", "period 16ms; shield 8;")
        (tmp_path / "joints.soter").write_text(text)
        warned = soter.load(tmp_path / "joints.soter").check().warnings
        return [d.message for d in warned if d.code == "W033"]

    first, second = (f"{writing.of.format(i)} in [-1.0, 1.0] / 40" for i in range(JOINTS))
    assert warnings(f"grid {first}; grid {second};") == []
    (told,) = warnings(f"grid {first}, {second};")
    assert all(f"`{n}`" in told for n in names)
