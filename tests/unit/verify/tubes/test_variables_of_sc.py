"""An SC that keeps variables, beside `rest`: any number of a range that no step leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.tubes.small_rests import drawn
from bench.tubes.tube_module import Loop, module_of

from long_tests import examples, seed_of
from soter.certificate.rechecker import recheck
from soter.diagnostics.diagnostic import SoterError
from soter.verify.problem.problem import Interval
from soter.verify.tubes import sc_step
from unit.verify.tubes.test_rest_claims import HELD, verified

if TYPE_CHECKING:
    from pathlib import Path

STEP = "step { publish push = clamp(-3.0 * seen, -1.0, 1.0); }"


def keeping(declared: str, code: str, added: str) -> str:
    """HELD with variables of SC, what a step makes of them, and what it adds to its command."""
    assert HELD.count(STEP) == 1
    answer = f"publish push = clamp(-3.0 * seen + {added}, -1.0, 1.0);"
    return HELD.replace(STEP, f"{declared}\n  step {{ {code} {answer} }}")


FLOAT = "var i: float = 0.0;"
INTEGRAL = "i = clamp(i - 0.02 * seen, -0.2, 0.2);"
FILTER = "i = i + 0.1 * (seen - i);"
KEPT = {
    "an integral": (FLOAT, INTEGRAL, "i"),
    "a filter": (FLOAT, FILTER, "0.05 * i"),
    "what is read at a takeover": (f"{FLOAT} on takeover {{ i = seen; }}", "", "0.05 * i"),
    "a truth": ("var b: bool = false;", "b = seen > 0.1 || b && seen > 0.0;", "(b ? -0.1 : 0.1)"),
    "a count": ("var n: int in [0, 9];", "if n < 9 { n = n + 1; }", "0.01 * float(n)"),
    "a phase": ("var p: Phase;", "p = Phase.Hold;", "(p == Phase.Go ? 0.05 : 0.0)"),
    "numbers of a record": (
        "var r: { a: float, b: float[2] };",
        "r.b[1] = r.a; r.a = clamp(r.a + seen, -0.05, 0.05); r.b[0] = min(max(seen, 0.0), 0.1);",
        "r.a + r.b[0] - r.b[1]",
    ),
    "a branch that leaves it": (FLOAT, f"if abs(seen) < 1.0 {{ {INTEGRAL} }}", "i"),
}
PHASE = ("topic push", "type Phase = enum { Hold, Go };\ntopic push")


@pytest.mark.parametrize("name", KEPT)
def test_what_an_sc_that_keeps_something_holds_is_proved_and_shown_again(
    tmp_path: Path, name: str
) -> None:
    m = verified(tmp_path, keeping(*KEPT[name]).replace(*PHASE), tmp_path / "proof")
    assert (m.findings["P2a"].verdict, m.findings["start"].verdict) == ("proved", "proved")
    assert m.not_rechecked == ""
    report = recheck(tmp_path / "proof")
    assert report.verdict == "accepted", report.reason
    assert {"P2a", "start"} <= set(report.modules[0].confirmed)


WRONG = {
    "an integral that may push as hard as SC": (
        FLOAT,
        INTEGRAL.replace("-0.2, 0.2", "-0.9, 0.9"),
        "i",
    ),
    "a step that pushes away": (FLOAT, INTEGRAL, "6.0 * seen + i"),
    "an anchor anywhere": (f"{FLOAT} on takeover {{ i = seen; }}", "", "3.0 * i"),
    "a takeover that loads the integral": (
        f"{FLOAT} on takeover {{ i = seen; }}",
        f"let before = i; {INTEGRAL}",
        "before",
    ),
    "a truth that turns SC round": ("var b: bool;", "b = !b;", "(b ? 6.0 * seen : 0.0)"),
    "a truth that is never true": ("var b: bool;", "", "(b ? 6.0 * seen : 0.0)"),
    "a count to full speed": ("var n: int in [0, 9];", "", "(n > 8 ? 1.0 : 0.0)"),
    "a value that is far out at first": ("var i: float = 1.0;", "if seen > 1.9 { i = 0.0; }", "i"),
    "a number below which a root faults": (FLOAT, INTEGRAL, "0.1 * sqrt(i + 0.1)"),
    "a takeover that faults": (
        f"{FLOAT} on takeover {{ assert seen < 1.5; i = 0.0; }}",
        INTEGRAL,
        "i",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_hold_of_all_that_sc_may_keep_is_not_proved(
    tmp_path: Path, name: str
) -> None:
    m = verified(tmp_path, keeping(*WRONG[name]))
    assert m.findings["P2a"].verdict == "undecided"


def test_a_range_that_a_step_leaves_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the search finds."""

    def halved(_: Interval, after: Interval) -> Interval:
        return Interval(0.5 * after.low, 0.5 * after.high)

    monkeypatch.setattr(sc_step, "_narrowed_range", halved)
    m = verified(tmp_path, keeping(*KEPT["an integral"]))
    assert m.findings["P2a"].verdict == "undecided"
    assert m.findings["P2a"].text.startswith("on something in the sets of what it reads")


REFUSED = {
    "no bound is seen of `i`": (FLOAT, "i = i - 0.02 * seen;", "clamp(i, -0.1, 0.1)"),
    "no bound is seen of `r.a`": ("var r: { a: float };", "r.a = 2.0 * r.a + seen;", "0.0"),
    "a time, an age or a mode": (f"{FLOAT} on takeover {{ i = time; }}", "", "0.0"),
    "`n`, a `int`: 64 values": ("var n: int;", "n = 1;", "0.0"),
    "whole numbers: 64 values": ("var n: int in [0, 9]; var k: int in [0, 9];", "", "0.0"),
    "hangs on what is measured": (
        "var n: int in [0, 9];",
        "if seen > 0.0 { n = 0; } elseif n < 9 { n = n + 1; }",
        "0.0",
    ),
    "`l`, a": ("var l: float[<=3];", "l = [];", "0.0"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_has_no_bound_or_too_many_values_is_refused(tmp_path: Path, why: str) -> None:
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, keeping(*REFUSED[why]))
    (told,) = caught.value.diagnostics
    assert told.code == "R007"
    assert why in told.message
    assert told.helps or told.notes


def test_the_range_of_a_filter_is_hardly_wider_than_what_it_reads() -> None:
    module = module_of("held.soter", keeping(FLOAT, FILTER, "0.05 * i"))
    (r,) = module.check.variables.values()
    assert -2.02 < r.low < -2.0
    assert 2.0 < r.high < 2.02


def test_one_number_that_two_commands_answer_to_is_one_in_both() -> None:
    """Of u0 = i and u1 = -i the sum is 0; of two numbers it would be up to 0.4."""
    text = keeping(FLOAT, INTEGRAL, "i").replace("der v = push", "der v = push.a + push.b")
    text = text.replace("topic push: float in [-1.0, 1.0] = 0.0;", PAIR)
    text = text.replace("publish push = 1.0", "publish push = { a: 1.0, b: 1.0 }")
    answer = "publish push = clamp(-3.0 * seen + i, -1.0, 1.0);"
    assert text.count(answer) == 1
    apart = (
        "publish push = { a: -1.5 * clamp(seen, -0.2, 0.2) + i, b: clamp(-seen, -0.5, 0.5) - i };"
    )
    kept = [module_of("two.soter", text.replace(answer, t)).kept for t in (apart, OTHERS)]
    assert kept == [True, False]


PAIR = """topic push: { a: float, b: float } in { a in [-1.0, 1.0], b in [-1.0, 1.0] };"""
OTHERS = "publish push = { a: -1.5 * clamp(seen, -0.2, 0.2) + i, b: clamp(-seen, -0.5, 0.5) + i };"


@pytest.mark.parametrize("number", range(examples(4)))
@pytest.mark.random
def test_runs_of_an_sc_that_keeps_something_stay_in_their_tubes(number: int) -> None:
    """Whatever it has kept within its ranges, at every step anew or from step to step."""
    of = 4 * seed_of(number) + number % 4
    module = module_of("small.soter", drawn(of, keeps=True), claimed=False)
    told = Loop(module, "-O1").run("contain", number, 4_000, 0)
    assert told.outside == 0


def test_runs_leave_a_tube_that_forgets_what_sc_keeps() -> None:
    """The value at first in the place of all that it may be."""

    def forgets(text: str) -> str:
        before, after = text.split("const KEPT_BY_SC: Form[1] = ")
        form, rest = after.split("];\n", 1)
        narrow = "[{ c: 0.3, r: 0.0, lo: 0.3, hi: 0.3, g: NONE }"
        assert form != narrow
        return f"{before}const KEPT_BY_SC: Form[1] = {narrow}];\n{rest}"

    module = module_of("small.soter", drawn(0, keeps=True), forgets, claimed=False)
    assert Loop(module, "-O1").run("contain", 0, 4_000, 0).outside


@pytest.mark.parametrize("asked", ["time < 500.0", "age(seen) < 0.005"])
def test_a_takeover_that_asks_for_a_time_is_refused(tmp_path: Path, asked: str) -> None:
    with pytest.raises(SoterError, match="a time, an age or a mode"):
        verified(tmp_path, keeping(f"on takeover {{ assert {asked}; }}", "", "0.0"))
