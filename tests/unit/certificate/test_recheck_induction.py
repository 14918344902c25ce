"""Certificates of inductions: accepted by another encoding, rejected when they were made wrong."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import pytest

from generators.opaque_planner import OPAQUE as SLOW
from long_tests import some
from soter.api.program import load
from soter.api.rechecking import recheck
from soter.certificate.induction import check_claims
from soter.certificate.induction.check_claims import read_entry, recheck_induction
from soter.certificate.induction.induction_problem import compare_entry, read_induction
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.front_end import check_file, system_to_prove
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.language.model.system import System

pytest.importorskip("z3")
pytest.importorskip("flint")

PLANNER = """soter 1;
type Plan = enum { Hover, Around, ThroughBuilding };
topic candidate: Plan;
topic inForce: Plan;
fun good(p: Plan): bool { return p != Plan.ThroughBuilding; }
node Any period 10ms { publishes candidate; step { publish candidate = choose Plan; } }
node Hold period 10ms { publishes candidate; step { publish candidate = Plan.Hover; } }
node Follower period 10ms {
  subscribes candidate;
  publishes inForce;
  var plan: Plan;
  step {
    if age(candidate) > seconds(30ms) { plan = candidate; }
    publish inForce = plan;
  }
}
rta Planner {
  ac Any;
  sc Hold;
  period 20ms;
  safe good(inForce);
  ttf !good(candidate);
  safer good(candidate);
  verify { induction; lemma good(candidate) || age(candidate) <= seconds(30ms); }
}
system S default { node Follower; module Planner; until 1s; }
"""


def certificate(tmp_path: Path, text: str = PLANNER) -> Path:
    program = tmp_path / "planner.soter"
    program.write_text(text)
    load(program).verify(cert=tmp_path / "cert", refute=False)
    return tmp_path / "cert"


def sealed_again(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """The same certificate with another manifest, sealed as a new one would be."""
    manifest = json.loads((folder / "manifest.json").read_text())
    change(manifest)
    raw = (json.dumps(manifest, sort_keys=True, separators=(",", ":")) + "\n").encode()
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")


def test_what_was_proved_is_accepted(tmp_path: Path) -> None:
    report = recheck(certificate(tmp_path))
    assert report.accepted, report.reason
    assert report.safe
    assert report.has_return
    (module,) = report.modules
    assert module.times["k"] >= 1


@pytest.mark.parametrize(("op", "returns"), [("-", False), ("+", True)])
def test_a_return_that_a_nan_forbids_is_not_confirmed(
    op: str, returns: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A prover that does not know that a NaN in `safer` is danger claims P2b."""
    monkeypatch.setattr("soter.core.steps.maybe_nan", lambda *_: frozenset())
    root = f"sqrt(age(candidate) {op} 100.0) < 0.0"
    text = PLANNER.replace("safer good(candidate);", f"safer good(candidate) && ({root} || true);")
    assert text != PLANNER
    report = recheck(certificate(tmp_path, text))
    assert report.accepted is report.has_return is returns, report.reason


OTHER = """topic shown: int;
node Other period 10ms phase PHASE { publishes shown; jitter 4ms; step { publish shown = 1; } }
"""


def test_the_smallest_int_has_a_remainder_by_minus_one(tmp_path: Path) -> None:
    """It is 0 (docs/semantics.md, Numbers); the quotient is the fault."""
    hold = "step { publish candidate = Plan.Hover; }"
    assert hold in PLANNER
    smallest = """var k: int = -9223372036854775807; step {
      let zero = (k - 1) % -1 == 0;
      publish candidate = zero ? Plan.Hover : Plan.ThroughBuilding;
    }"""
    assert recheck(certificate(tmp_path, PLANNER.replace(hold, smallest))).accepted
    faults = smallest.replace("% -1", "/ -1")
    (tmp_path / "faults.soter").write_text(PLANNER.replace(hold, faults))
    (module,) = load(tmp_path / "faults.soter").verify(refute=False).modules
    assert module.findings["P2a"].verdict != "proved"


def beside(phase: str) -> str:
    """Somebody in the thread who may be late, and whom the proof does not follow."""
    text = PLANNER.replace("rta Planner", OTHER.replace("PHASE", phase) + "rta Planner")
    return text.replace("{ node Follower;", "{ node Other; node Follower;")


def test_who_is_late_and_delays_nobody_that_is_followed(tmp_path: Path) -> None:
    """Released 5 ms after the others, it is done 1 ms before they are released again."""
    report = recheck(certificate(tmp_path, beside("5ms")))
    assert report.accepted, report.reason
    assert report.safe


def test_who_is_late_and_delays_others(tmp_path: Path) -> None:
    """What was proved of a thread in which nobody waits for it."""
    folder = certificate(tmp_path, beside("5ms"))
    source = folder / "program" / "planner.soter"
    source.write_text(source.read_text().replace("phase 5ms", "phase 7ms"))
    checked = check_file(str(source)).program
    assert checked is not None

    def change(manifest: dict[str, Any]) -> None:
        manifest["files"]["program/planner.soter"] = hashlib.sha256(source.read_bytes()).hexdigest()
        manifest["program_sha256"] = checked.sha256

    sealed_again(folder, change)
    report = recheck(folder)
    assert not report.accepted
    assert report.verdict == "not re-checked"
    assert ": releases that are late (`jitter`), and with" in report.reason


def edited(key: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["induction"][key] = value

    return change


def clock(manifest: dict[str, Any]) -> None:
    manifest["modules"][0]["induction"]["clocks"]["Follower"][0] = 20_000_000


def claim(manifest: dict[str, Any]) -> None:
    manifest["modules"][0]["claims"]["P1c"] = "proved"


def law(manifest: dict[str, Any]) -> None:
    """Of plants an induction says nothing: nobody would look at it."""
    manifest["modules"][0]["claims"]["failsafe"] = "proved"


def left_out(manifest: dict[str, Any]) -> None:
    del manifest["modules"][0]["induction"]["clocks"]["Follower"]


@pytest.mark.parametrize(
    "change",
    [
        edited("k", 0),
        edited("k", -1),
        edited("k", True),
        edited("k", 10**9),
        edited("returns", 0),
        edited("lemmas", []),
        edited("lemmas", ["good(candidate)"]),
        edited("hyperperiod_ns", 10_000_000),
        clock,
        claim,
        law,
        left_out,
    ],
)
def test_a_manifest_made_wrong_is_rejected(
    tmp_path: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    folder = certificate(tmp_path)
    sealed_again(folder, change)
    assert not recheck(folder).accepted


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("seconds(30ms) { plan", "seconds(20ms) { plan"),
        ("age(candidate) >", "age(candidate) >="),
        ("publish candidate = Plan.Hover", "publish candidate = Plan.ThroughBuilding"),
        ("ttf !good(candidate)", "ttf false"),
        ("period 20ms", "period 30ms"),
        ("lemma good(candidate) ||", "lemma good(candidate) &&"),
        ("induction;", "induction; late sc 1ms;"),
        ("node Hold period 10ms", "node Hold period 20ms"),
    ],
)
def test_a_program_made_wrong_is_rejected(tmp_path: Path, old: str, new: str) -> None:
    """The program, its hash and the manifest are those of the wrong program; the claims are not."""
    good = certificate(tmp_path)
    claims = json.loads((good / "manifest.json").read_text())["modules"]
    (tmp_path / "wrong").mkdir()
    assert old in PLANNER
    wrong = certificate(tmp_path / "wrong", PLANNER.replace(old, new))

    def put(manifest: dict[str, Any]) -> None:
        own = manifest["modules"][0]["induction"]
        manifest["modules"] = claims
        claims[0]["induction"]["clocks"] = own["clocks"]
        claims[0]["induction"]["hyperperiod_ns"] = own["hyperperiod_ns"]
        claims[0]["induction"]["lemmas"] = own["lemmas"]

    sealed_again(wrong, put)
    assert not recheck(wrong).accepted


def test_too_small_a_k_is_rejected(tmp_path: Path) -> None:
    """The plan in force is a copy of a copy: one hyperperiod of hypothesis is not enough."""
    text = PLANNER.replace("period 20ms", "period 10ms").replace("30ms", "20ms")
    text = text.replace("lemma good(candidate) || age(candidate) <= seconds(20ms);", "")
    folder = certificate(tmp_path, text)
    manifest = json.loads((folder / "manifest.json").read_text())
    k = manifest["modules"][0]["induction"]["k"]
    assert k > 1
    assert recheck(folder).accepted
    sealed_again(folder, edited("k", k - 1))
    assert not recheck(folder).accepted


def test_a_greater_k_than_is_needed_is_hardly_more_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it is asked whether AC ever has control. The solver counts its work itself."""
    folder, done = certificate(tmp_path), [0]
    answer = check_claims._ask_solver

    def counted(facts: Any, *rest: Any) -> Any:
        said = answer(facts, *rest)
        done[-1] = facts.work
        return said

    monkeypatch.setattr(check_claims, "_ask_solver", counted)
    for k in (1, 64):
        sealed_again(folder, edited("k", k))
        done.append(0)
        report = recheck(folder)
        assert report.accepted
        assert report.modules[0].unseen == ""
    assert 0 < done[2] < 3 * done[1]


OPAQUE = SLOW.replace("period 400ms", "period 40ms")


@pytest.mark.long
def test_what_is_opaque_is_accepted_as_far_as_it_is_proved(tmp_path: Path) -> None:
    """P2b rests on `progress`: assumed, and not confirmed."""
    report = recheck(certificate(tmp_path, OPAQUE))
    assert report.accepted, report.reason
    assert report.safe
    assert not report.has_return
    (module,) = report.modules
    assert any("latches its node" in a.text for a in module.assumptions)


def latching(manifest: dict[str, Any]) -> None:
    manifest["modules"][0]["induction"]["latching"] = False


def returns(manifest: dict[str, Any]) -> None:
    manifest["modules"][0]["claims"]["P2b"] = "proved"
    manifest["modules"][0]["induction"]["returns"] = 3


@pytest.mark.parametrize("change", some([latching, returns, edited("progress", [])], 1))
@pytest.mark.long
def test_more_than_is_proved_of_what_is_opaque_is_rejected(
    tmp_path: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    folder = certificate(tmp_path, OPAQUE)
    sealed_again(folder, change)
    assert not recheck(folder).accepted


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("&& good(candidate) { now", "{ now"),
        ("good(candidate) { now", "good(now) { now"),
        ("publish inForce = now", "publish inForce = candidate"),
        ("{ now = candidate; }", "{ now.ends = candidate.ends; now.n = 1; }"),
        ("safe inForce.n == 0 ||", "safe"),
        ("  publishes inForce;\n", "  publishes inForce;\n  failsafe inForce = BAD;\n"),
    ],
    ids=["unchecked", "another", "around", "parts", "at the start", "fail-safe"],
)
def test_wrong_programs_of_what_is_opaque_are_rejected(tmp_path: Path, old: str, new: str) -> None:
    text = OPAQUE.replace("topic asked", "const BAD: Way = { ends: [1.0], n: 1 };\ntopic asked")
    good = certificate(tmp_path, text)
    (module,) = json.loads((good / "manifest.json").read_text())["modules"]
    assert module["claims"]["P2a"] == "proved"
    (tmp_path / "wrong").mkdir()
    assert old in text
    wrong = certificate(tmp_path / "wrong", text.replace(old, new))
    sealed_again(wrong, lambda manifest: manifest.update(modules=[module]))
    report = recheck(wrong)
    assert not report.accepted
    assert "something fails" in report.reason


@pytest.mark.long
def test_a_predicate_that_ends_in_an_extern_function_is_not_rechecked(tmp_path: Path) -> None:
    """What was good may be bad when it is asked again."""
    folder = certificate(tmp_path, OPAQUE)
    drawn = 'extern fun drawn(x: float): float from "c:drawn.c:drawn";\nfun good'
    asked = ("return most < 0.5;", "return drawn(most) < 0.5;")
    small_proofs.edit_program(folder, ("fun good", drawn), asked)
    report = recheck(folder)
    assert report.verdict == "not re-checked"
    assert "`good` is an extern function, or asks one" in report.reason


VACUOUS = {
    "AC never keeps control": ("ttf !good(candidate)", "ttf good(candidate) || !good(candidate)"),
    "AC never has control": (
        "safer good(candidate)",
        "returns never; safer candidate == Plan.Around",
    ),
    "`safe` reads no topic": ("safe good(inForce)", "safe 1 < 2"),
}


@pytest.mark.parametrize("said", VACUOUS)
def test_a_proof_of_nothing_is_told_by_who_checks_it(said: str, tmp_path: Path) -> None:
    """By the solver, of the program: no certificate says anything about it."""
    old, new = VACUOUS[said]
    assert old in PLANNER
    report = recheck(certificate(tmp_path, PLANNER.replace(old, new)))
    assert report.accepted, report.reason
    (told,) = report.why_vacuous.values()
    assert said in told


def test_a_proof_of_something_has_no_such_words(tmp_path: Path) -> None:
    report = recheck(certificate(tmp_path))
    assert report.accepted, report.reason
    assert (report.why_vacuous, report.modules[0].unseen) == ({}, "")


# ---------------------------------------------------------------- refused before it is asked

CLOCKS = {name: [10_000_000, 0, 0, 0] for name in ("Planner.Any", "Planner.Hold", "Follower")}
INDUCTION = {
    "k": 1,
    "returns": 3,
    "hyperperiod_ns": 20_000_000,
    "lemmas": ["good(candidate) || age(candidate) <= seconds(30ms)"],
    "progress": [],
    "latching": False,
    "clocks": {"Planner.dm": [20_000_000, 0, 0, 0], **CLOCKS},
}
LEMMA = "induction; lemma good(candidate) || age(candidate) <= seconds(30ms);"
READ = "publishes candidate; step { publish candidate = choose Plan; }"


def flat_of(folder: Path, *pairs: tuple[str, str]) -> System:
    text = PLANNER
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "planner.soter").write_text(text)
    checked = check_file(str(folder / "planner.soter"))
    assert checked.ok, checked.diagnostics
    return system_to_prove(checked, "S")


@all_rows(
    ("old", "new", "refused"),
    [
        (LEMMA, "", "does not ask for an induction"),
        ("module Planner;", "module Planner; force Planner sc;", "forced to sc"),
        ("induction;", "induction; dropout 20ms;", "speaks of sets"),
        ("induction;", "induction; late sc 1ms;", "steps that are late, or take time"),
        (READ, f"takes [1ms, 2ms]; {READ}", "steps that are late, or take time"),
        (READ, f"wcet 1ms; {READ}", "declared execution times"),
        (READ, f"jitter 1ms; {READ}", "`Planner.Any`"),
    ],
)
def test_a_program_that_is_not_for_an_induction_is_refused(
    tmp_path: Path, old: str, new: str, refused: str
) -> None:
    assert read_induction(flat_of(tmp_path), "Planner").hyperperiod == 20_000_000
    with pytest.raises((RejectedError, NotRecheckedError), match=refused):
        read_induction(flat_of(tmp_path, (old, new)), "Planner")


@all_rows(
    ("variable", "step", "refused"),
    [
        ("k: int = 1", "k = 7 / k;", "a division by what is not known"),
        ("f: float = 1.0", "f = f / 2.0;", "a division of floats"),
        ("f: float = 1.0", "let k = int(f);", "`int` outside of a function"),
        ("k: int", "plan = fair choose { candidate, Plan.Hover };", "a fair choice"),
        ("k: int", "k = k + 1; let ks: int[<=3] = [k];", "a list or a large array"),
    ],
)
def test_a_step_that_the_solver_is_not_told_is_not_rechecked(
    tmp_path: Path, variable: str, step: str, refused: str
) -> None:
    publish = "publish inForce"
    flat = flat_of(tmp_path, ("var plan", f"var {variable}; var plan"), (publish, step + publish))
    with pytest.raises(NotRecheckedError, match=refused):
        read_entry(flat, {"module": "Planner", "induction": INDUCTION})


def test_a_module_that_the_system_does_not_have_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(RejectedError, match="has no module `Other`"):
        read_induction(flat_of(tmp_path), "Other")


@all_rows(
    ("change", "refused"),
    [
        ({"latching": 0}, "`latching` is no truth"),
        ({"clocks": []}, "`clocks` are not as they should be"),
        ({"steps": 1}, "`induction` is not as it should be"),
        ({"k": 65}, "`k` of the induction is no number"),
        ({"hyperperiod_ns": 1}, "the hyperperiod is 20000000 ns"),
    ],
)
def test_a_wrong_entry_of_an_induction_is_rejected(
    tmp_path: Path, change: dict[str, Any], refused: str
) -> None:
    facts = read_induction(flat_of(tmp_path), "Planner")
    assert compare_entry(facts, INDUCTION) == (1, 3)
    with pytest.raises(RejectedError, match=refused):
        compare_entry(facts, INDUCTION | change)


@all_rows(
    ("pairs", "change", "refused"),
    [
        ((), {"more": 1}, "is not as it should be"),
        ((), {"recover_ns": 1}, "no time within which SC gives control back"),
        ((), {"induction": INDUCTION | {"latching": True}}, "rests on what nobody proves"),
        ((("induction;", "induction; recover within 70ms;"),), {}, "later than `recover within`"),
    ],
)
def test_a_return_that_an_induction_does_not_show_is_rejected(
    tmp_path: Path, pairs: tuple[tuple[str, str], ...], change: dict[str, Any], refused: str
) -> None:
    entry: dict[str, Any] = {"system": "S", "module": "Planner", "claims": {"P2b": "proved"}}
    entry |= {"recover_ns": None, "induction": INDUCTION}
    assert recheck_induction(flat_of(tmp_path), entry)[1].confirmed == ["P2b"]
    with pytest.raises(RejectedError, match=refused):
        recheck_induction(flat_of(tmp_path, *pairs), entry | change)


@all_rows(
    ("figure", "most", "refused"),
    [
        ("RELEASES_MAX", 9, "more than are gone through"),
        ("WORK_OF_ALL", 0, "more work than is done"),
        ("WORK", 1, "does not decide it"),
    ],
)
def test_more_work_than_is_allowed_is_not_rechecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, figure: str, most: int, refused: str
) -> None:
    entry: dict[str, Any] = {"system": "S", "module": "Planner", "claims": {"P2b": "proved"}}
    entry |= {"recover_ns": None, "induction": INDUCTION}
    monkeypatch.setattr(check_claims, figure, most)
    with pytest.raises(NotRecheckedError, match=refused):
        recheck_induction(flat_of(tmp_path), entry)
