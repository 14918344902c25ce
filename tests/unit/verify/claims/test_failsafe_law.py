"""The fail-safe law: what `soter verify` and `soter recheck` say of it, and what they refuse."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import recheck
from soter.language.front_end import check_file, system_of
from soter.verify.deploy.missing_predicates import complete
from soter.verify.period_advice import sweep_periods
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from soter.verify.scope import problem_key
from soter.verify.verify_module import verify_module
from unit.certificate.small_proofs import edit_program, reseal

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

STOP = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {
  reads vel;
  drives pos = x;
  state x: float;
  disturbance wind: float in [-WIND, WIND];
  der x = vel + wind;
}
node Fast period 10ms {
  subscribes pos;
  publishes vel;
  step { publish vel = clamp(9.0 - pos, -1.0, 1.0); }
}
node Stop period 10ms { subscribes pos; publishes vel; step { publish vel = SC; } }
rta Guard {
  ac Fast;
  sc Stop;
  period 50ms;
  safe abs(pos) < 10.0;
  failsafe vel = LAW;
  verify {
    grid pos in [-10.0, 10.0] / 100;
    late dm 1ms, sc 1ms;
    response dm 1ms, sc 1ms;
    acts within 2ms;
    recover never;
  }
}
system Track { c: Cart; module Guard; until 10s; }
"""
LINES = {"WIND": "0.0", "SC": "0.0", "LAW": "0.0"}


def text(**changed: str) -> str:
    source = STOP
    for name, value in (LINES | changed).items():
        if name in LINES:
            source = source.replace(name, value)
    for old, new in changed.items():
        source = source if old in LINES else source.replace(old, new)
    return source


def verified(source: str) -> ModuleResult:
    checked = check_file("stop.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return verify_module(extract(flat, flat.modules[0]), refute=False)


def test_an_emergency_stop_and_its_law_are_proved() -> None:
    module_result = verified(text())
    assert module_result.verdict == "proved"
    said = {n: f.verdict for n, f in module_result.findings.items()}
    assert said == {**dict.fromkeys(said, "proved"), "P2b": "assumed"}
    assert module_result.core_share > 0.97
    assert any(
        "from the end of the lease on" in a for a in assumption_texts(module_result.assumptions)
    )


def test_a_cell_that_stands_still_is_mapped_to_itself() -> None:
    """K = C: no cell is lost to outward rounding, at the border neither."""
    (group,) = verified(text()).cases[0].groups
    assert ((group.core > 0) == group.allowed).all()


@pytest.mark.parametrize(
    ("changed", "law", "rest"),
    [
        ({"LAW": "0.001"}, "undecided", "proved"),  # drifts
        ({"LAW": "-1.0"}, "undecided", "proved"),  # a latched constant is not safe by itself
        ({"SC": "0.001"}, "undecided", "undecided"),  # SC drifts
        ({"WIND": "0.001"}, "undecided", "undecided"),  # pushed, and nobody answers
    ],
)
def test_what_does_not_stand_still_is_not_proved(
    changed: dict[str, str], law: str, rest: str
) -> None:
    findings = verified(text(**changed)).findings
    assert findings["failsafe"].verdict == law
    assert {findings[n].verdict for n in ("P2a", "P3", "start")} == {rest}


HILL = {
    "SC": "clamp(-3.0 * pos, -1.0, 1.0)",
    "der x = vel + wind;": "der x = x * x * x - x + vel + wind;",
    "abs(pos) < 10.0": "abs(pos) < 1.2",
    "[-10.0, 10.0] / 100": "[-1.5, 1.5] / 60",
}
"""Without thrust it falls to 0 from |x| < 1 and runs away beyond; SC can hold it up to 1.3."""


@pytest.mark.long
def test_sc_has_to_keep_what_the_law_keeps() -> None:
    free, bound = (
        verified(text(**HILL).replace("  failsafe vel = 0.0;\n", "")),
        verified(text(**HILL)),
    )
    assert bound.findings["failsafe"].verdict == "proved"
    assert {f.findings["P2a"].verdict for f in (free, bound)} == {"proved"}
    (before,), (after,), (law,) = (
        module_result[0].groups for module_result in (free.cases, bound.cases, bound.laws)
    )
    edges = before.edges[0]
    assert max(edges[i + 1] for i in before.core.nonzero()[0]) > 1.05
    assert 0.8 < max(edges[i + 1] for i in after.core.nonzero()[0]) <= 1.0
    assert ((after.core > 0) <= (law.core > 0)).all()
    assert after.core.sum() > 0


THRUST = """soter 1;
topic motion: { x: float, v: float } max_age 20ms;
topic accel: float in [-3.0, 3.0] = 0.0;
plant Cart period 10ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float;
  state v: float;
  der x = v;
  der v = accel;
}
node Fast period 10ms { subscribes motion; publishes accel; step { publish accel = 3.0; } }
node Careful period 10ms {
  subscribes motion;
  publishes accel;
  step { publish accel = clamp(-2.0 * motion.x - 3.0 * motion.v, -3.0, 3.0); }
}
rta Guard {
  ac Fast;
  sc Careful;
  period 50ms;
  safe abs(motion.x) < 10.0;
  failsafe accel = LAW;
  verify { grid motion.x in [-10.0, 10.0] / 60, motion.v in [-6.0, 6.0] / 40; }
}
system Track { c: Cart; module Guard; until 10s; }
"""


@pytest.mark.parametrize("law", ["0.0", "-3.0"])
def test_a_body_that_only_brakes_by_thrust_has_no_law(law: str) -> None:
    """It coasts on, or constant braking reverses it."""
    findings = verified(THRUST.replace("LAW", law)).findings
    assert findings["failsafe"].verdict == "undecided"
    assert findings["P2a"].verdict == "proved", "of SC that is said, as without a law"


def test_the_table_of_the_dm_is_computed_inside_what_the_law_keeps() -> None:
    """What a run or a package gets, also from the cache: another law, another table."""
    share_by_law: dict[str, str] = {}
    for law in ("0.0", "none", "0.3", "0.0"):
        line = "" if law == "none" else f"  failsafe vel = {law};\n"
        source = text(**HILL).replace("  failsafe vel = 0.0;\n", line)
        flat = system_of(check_file("stop.soter", source), None)
        (note,) = complete(flat)
        share = re.search(r"on ([0-9.]+)% of the estimates \(S_0\)", note)
        assert share is not None, note
        assert share_by_law.setdefault(law, share[1]) == share[1]
    assert float(share_by_law["0.3"]) < float(share_by_law["0.0"]) < float(share_by_law["none"])


def test_advice_does_not_ask_for_p2b_where_the_program_does_not() -> None:
    checked = check_file("stop.soter", text())
    flat = system_of(checked, None)
    advice = sweep_periods(extract(flat, flat.modules[0]), (1.0,))
    assert advice.best_ns == 50_000_000


def test_a_node_that_reads_what_the_module_publishes_would_stop_too() -> None:
    mixer = """topic wheel: float in [-1.0, 1.0];
node Mixer period 10ms { subscribes vel; publishes wheel; step { publish wheel = vel; } }
rta Guard {"""
    source = (
        text().replace("rta Guard {", mixer).replace("module Guard;", "module Guard; node Mixer;")
    )
    module_result = verified(source)
    assert module_result.findings["failsafe"].verdict == "undecided"
    assert "`Mixer` reads" in module_result.findings["failsafe"].text
    assert module_result.findings["P2a"].verdict == "proved"


def test_without_a_law_it_is_assumed() -> None:
    module_result = verified(text().replace("  failsafe vel = 0.0;\n", ""))
    assert module_result.findings["failsafe"].verdict == "assumed"
    assert module_result.verdict == "proved"


def test_p2b_is_asked_where_nothing_says_never() -> None:
    module_result = verified(text().replace("    recover never;\n", ""))
    assert module_result.findings["P2b"].verdict == "undecided"
    assert module_result.findings["P2a"].verdict == "proved"


VIEWS = """soter 1;
const NEAR: float = 1.0;
topic motion: { x: float } max_age 20ms;
topic left: { room: float } max_age 20ms;
topic right: { room: float } max_age 20ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {
  reads push;
  drives motion = { x: x };
  state x: float;
  der x = push;
}
plant Left period 10ms {
  reads push;
  drives left = { room: r };
  state r: float = 3.0;
  der r = push;
}
plant Right period 10ms {
  reads push;
  drives right = { room: r };
  state r: float = 3.0;
  der r = -push;
}
node Estimator period 10ms {
  subscribes motion;
  publishes left, right;
  step {
    publish left = { room: motion.x + 4.0 };
    publish right = { room: 4.0 - motion.x };
  }
}
node Fast period 10ms { publishes push; step { publish push = 1.0; } }
node Stop period 10ms { publishes push; step { publish push = 0.0; } }
rta Keep {
  ac Fast;
  sc Stop;
  period 10ms;
  safe left.room >= 0.0 && right.room >= 0.0;
  ttf !(left.room > 0.2 && right.room > 0.2 && left.room < 7.8 && right.room < 7.8);
  safer left.room > 0.3 && right.room > 0.3 && left.room < 7.7 && right.room < 7.7;
  failsafe push = 0.0;
  verify {
    late dm 500us, sc 500us, Estimator 500us;
    response dm 200us, sc 200us, Estimator 200us;
    acts within 0ms;
    recover never;
    view left {
      abstracts d by seen: Left = { r: d.truth.x + 4.0 };
      grid seen.r in [0.0, 10.0] / 200;
    }
    view right {
      abstracts d by seen: Right = { r: 4.0 - d.truth.x };
      grid seen.r in [0.0, 10.0] / 200;
    }
  }
}
system S default {
  d: Cart;
  node Estimator;
  module Keep;
  until 10s;
}
"""


def test_a_law_is_proved_and_rechecked_in_every_view(tmp_path: Path) -> None:
    path = tmp_path / "views.soter"
    path.write_text(VIEWS)
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert [m.findings["failsafe"].verdict for m in report.modules] == ["proved", "proved"]
    recheck_report = recheck(tmp_path / "cert")
    assert recheck_report.accepted, recheck_report.reason
    assert all("failsafe" in m.confirmed for m in recheck_report.modules)


def test_the_law_is_not_proved_where_nothing_says_that_it_begins_in_k() -> None:
    bold = text().replace(
        "  verify {", "  ttf abs(pos) > 9.95;\n  safer abs(pos) < 9.0;\n  verify {"
    )
    findings = verified(bold).findings
    assert findings["P3"].verdict == "undecided"
    assert findings["failsafe"].verdict == "undecided"
    assert "P3" in findings["failsafe"].text


# ---------------------------------------------------------------- certificates


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("failsafe")
    path = folder / "stop.soter"
    path.write_text(text())
    soter.load(path).verify(cert=folder / "cert", refute=False)
    return folder / "cert"


def copied(proved: Path, folder: Path) -> tuple[Path, dict[str, object]]:
    made = Path(shutil.copytree(proved, folder / "cert"))
    return made, json.loads((made / "manifest.json").read_text())


def test_the_rechecker_confirms_the_law(proved: Path) -> None:
    recheck_report = recheck(proved)
    assert recheck_report.accepted, recheck_report.reason
    assert "failsafe" in recheck_report.modules[0].confirmed
    assert recheck_report.safe
    assert recheck_report.has_return, "P2b is not asked of a module with `recover never`"
    assert any("from the end of the lease on" in a for a in recheck_report.assumptions)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("failsafe vel = 0.0;", "failsafe vel = 0.5;", "does not certainly lead back to K"),
        ("failsafe vel = 0.0;", "", "declares no fail-safe law"),
        ("publish vel = 0.0;", "publish vel = 0.5;", "does not certainly lead back to K"),
    ],
)
def test_the_same_tables_for_another_program_are_rejected(
    proved: Path, tmp_path: Path, old: str, new: str, why: str
) -> None:
    folder, _ = copied(proved, tmp_path)
    manifest = edit_program(folder, (old, new))
    reseal(folder, manifest)
    recheck_report = recheck(folder)
    assert not recheck_report.accepted
    assert why in recheck_report.reason


def test_a_claim_without_sets_and_sets_without_a_claim_are_rejected(
    proved: Path, tmp_path: Path
) -> None:
    folder, manifest = copied(proved, tmp_path / "a")
    manifest["modules"][0].pop("law")  # type: ignore[index]
    reseal(folder, manifest)
    assert "sets of its law" in recheck(folder).reason
    folder, manifest = copied(proved, tmp_path / "b")
    manifest["modules"][0]["claims"]["failsafe"] = "assumed"  # type: ignore[index]
    reseal(folder, manifest)
    assert "sets of its law" in recheck(folder).reason
    folder, manifest = copied(proved, tmp_path / "c")
    manifest["modules"][0]["law"][0]["parameter"] = [1]  # type: ignore[index]
    reseal(folder, manifest)
    assert "the cases of the law are not those of the module" in recheck(folder).reason


def test_a_law_under_times_that_are_assumed_is_confirmed_under_them(tmp_path: Path) -> None:
    """Undeclared times are zero, assumed: P1c is H >= H* under them, as it is of all the rest."""
    path = tmp_path / "stop.soter"
    times = "    late dm 1ms, sc 1ms;\n    response dm 1ms, sc 1ms;\n    acts within 2ms;\n"
    path.write_text(text(**{times: ""}))
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    said = {n: f.verdict for n, f in report.modules[0].findings.items()}
    assert (said["P1c"], said["failsafe"]) == ("assumed", "proved")
    recheck_report = recheck(tmp_path / "cert")
    assert recheck_report.accepted, recheck_report.reason
    assert "failsafe" in recheck_report.modules[0].confirmed
    assert any("undeclared times are zero" in a for a in recheck_report.assumptions)


@pytest.mark.parametrize("missing", ["P1c", "P3", "start"])
def test_a_law_is_not_confirmed_beside_what_it_rests_on_and_is_not_claimed(
    proved: Path, tmp_path: Path, missing: str
) -> None:
    folder, manifest = copied(proved, tmp_path)
    manifest["modules"][0]["claims"][missing] = "undecided"  # type: ignore[index]
    reseal(folder, manifest)
    assert "nothing says that the law begins" in recheck(folder).reason


def test_a_k_that_is_not_inside_what_the_law_keeps_is_rejected(
    proved: Path, tmp_path: Path
) -> None:
    folder, manifest = copied(proved, tmp_path)
    entry = manifest["modules"][0]["law"][0]["groups"][0]  # type: ignore[index]
    path = folder / entry["K"]
    cells = bytearray(path.read_bytes())
    cells[50] = 0
    path.write_bytes(bytes(cells))
    reseal(folder, manifest)
    assert "what the law keeps" in recheck(folder).reason


BESIDE = (
    STOP.replace("der x = vel + wind;", "der x = vel + push;")
    .replace("reads vel;", "reads vel, push;")
    .replace("  disturbance wind: float in [-WIND, WIND];\n", "")
)
OTHER = """topic push: float in [-0.1, 0.1];
topic beside: float in [-9.0, 9.0];
plant Wind period 10ms { reads beside; drives push = 0.01 * y; state y: float; next y = beside; }
node Blow period 10ms { publishes beside; step { publish beside = 0.0; } }
node Calm period 10ms { publishes beside; step { publish beside = 0.0; } }
"""


def test_what_others_keep_nobody_keeps_once_all_has_stopped(tmp_path: Path) -> None:
    """A law that is fine while `push` stays in its set, which the trusted part saw to."""
    source = BESIDE.replace("topic vel", f"{OTHER}topic vel", 1)
    source = source.replace("c: Cart; module Guard;", "c: Cart; w: Wind; node Blow; module Guard;")
    for word, value in LINES.items():
        source = source.replace(word, value)
    path = tmp_path / "p.soter"
    path.write_text(source)
    flat = system_of(check_file(str(path)), "Track")
    problem = extract(flat, flat.modules[0])
    assert problem.influences
    assert "nobody keeps" in problem.law_unread
    assert problem.law is None


MAP = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 5ms;
topic u: float in [-6.0, 6.0] = 0.0;
plant P period 10ms { reads u; drives pos = x; state x: float; next x = 0.5 * x + u; }
node Fast period 10ms { publishes u; step { publish u = 6.0; } }
node Stop period 10ms { publishes u; step { publish u = 0.0; } }
rta Guard {
  ac Fast; sc Stop; period 10ms;
  safe abs(pos) < 10.0; ttf pos > 7.8 || pos < -7.8; safer abs(pos) < 7.8;
  failsafe u = 0.0;
  verify { grid pos in [-10.0, 10.0] / 400; }
}
system T { c: P; module Guard; until 10s; }
"""


def test_of_a_map_no_law_is_claimed() -> None:
    module_result = verified(MAP)
    assert module_result.findings["P3"].verdict == "proved"
    assert module_result.findings["failsafe"].verdict == "undecided"
    assert "in steps" in module_result.findings["failsafe"].text


def test_two_systems_are_not_the_same_where_one_leaves_the_law_undecided(tmp_path: Path) -> None:
    motor = """topic o: float;
node Motor period 10ms { subscribes vel; publishes o; step { publish o = vel; } }
system Track default { c: Cart; module Guard; until 10s; }
system Real { c: Cart; module Guard; node Motor; until 10s; }
"""
    path = tmp_path / "p.soter"
    path.write_text(text().replace("system Track { c: Cart; module Guard; until 10s; }", motor))
    checked = check_file(str(path))
    keys = []
    for name in ("Track", "Real"):
        flat = system_of(checked, name)
        keys.append(problem_key(extract(flat, flat.modules[0])))
    assert keys[0] != keys[1]
