"""Proofs by induction: what is proved, what is refuted with a run, and what never may be proved."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

import soter
from generators.opaque_planner import OPAQUE
from long_tests import some
from soter.api.program import load
from soter.diagnostics.diagnostic import SoterError
from soter.verify.problem.problem import assumption_texts
from soter.verify.proof_report import proof_page

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult, VerifyReport

pytest.importorskip("z3")

PLANNER = """soter 1;
const SETTLED: duration = 30ms;
type Plan = enum { Hover, Around, ThroughBuilding };
topic candidate: Plan;
topic inForce: Plan;
fun PhiPlan(p: Plan): bool { return p != Plan.ThroughBuilding; }
node RRTStar period 10ms {
  publishes candidate;
  step { if choose bool { publish candidate = choose Plan; } }
}
node HoverPlan period 10ms {
  publishes candidate;
  step { publish candidate = Plan.Hover; }
}
node Follower period 10ms {
  subscribes candidate;
  publishes inForce;
  var plan: Plan;
  step {
    if age(candidate) > seconds(SETTLED) {
      plan = candidate;
    }
    publish inForce = plan;
  }
}
rta SafePlanner {
  ac RRTStar;
  sc HoverPlan;
  period 20ms;
  safe PhiPlan(inForce);
  ttf !PhiPlan(candidate);
  safer PhiPlan(candidate);
  verify { induction; }
}
system Planning default { node Follower; module SafePlanner; until 160ms; }
"""


def verified(tmp_path: Path, *changes: tuple[str, str], refute: bool = True) -> VerifyReport:
    text = PLANNER
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "planner.soter"
    path.write_text(text)
    return load(path).verify(refute=refute)


def test_the_planner_is_proved_for_all_times(tmp_path: Path) -> None:
    module_result = verified(tmp_path)["SafePlanner"]
    assert module_result.verdict == "proved"
    assert module_result.findings["P2a"].counts["k"] >= 1
    assert module_result.findings["P2b"].verdict == "proved"
    assert module_result.findings["DM"].verdict == "proved"
    assert module_result.findings["P1c"].verdict == "assumed"
    assert any("any value" in a for a in assumption_texts(module_result.assumptions))


def test_a_threshold_that_is_too_short_is_refuted_by_a_run(tmp_path: Path) -> None:
    report = verified(tmp_path, ("SETTLED: duration = 30ms", "SETTLED: duration = 20ms"))
    finding = report["SafePlanner"].findings["P2a"]
    assert report.verdict == "refuted"
    assert "30 ms  violated" in str(finding.counterexample)


def test_strictness_matters(tmp_path: Path) -> None:
    report = verified(tmp_path, ("age(candidate) >", "age(candidate) >="))
    assert report.verdict == "refuted"


def test_phases_count(tmp_path: Path) -> None:
    phased = ("HoverPlan period 10ms", "HoverPlan period 10ms phase 9ms")
    assert verified(tmp_path, ("= 30ms", "= 29ms"), phased).verdict == "proved"


def test_a_nan_in_safer_gives_nothing_back(tmp_path: Path) -> None:
    """Its root is NaN for 100 s, whatever stands beside the comparison: AC gets no control."""
    root = "sqrt(age(candidate) - 100.0) < 0.0"
    changed = ("safer PhiPlan(candidate);", f"safer PhiPlan(candidate) && ({root} || true);")
    findings = verified(tmp_path, changed, refute=False)["SafePlanner"].findings
    assert findings["P2a"].verdict == "proved"
    assert findings["P2b"].verdict == "undecided"


@pytest.mark.long
def test_a_plan_that_is_published_again_and_again_never_settles(tmp_path: Path) -> None:
    again = ("publish candidate = Plan.Hover", "publish candidate = Plan.ThroughBuilding")
    report = verified(tmp_path, again)
    findings = report["SafePlanner"].findings
    assert findings["P2a"].verdict == "proved"
    assert findings["P2b"].verdict == "undecided"
    assert report.verdict == "undecided"


@pytest.mark.long
def test_declared_times_make_p1c_proved_and_need_a_longer_threshold(tmp_path: Path) -> None:
    nodes = "late dm 1ms, sc 1ms, Follower 1ms, RRTStar 1ms;"
    none = "response dm 0ms, sc 0ms, Follower 0ms, RRTStar 0ms;"
    declared = ("induction;", f"induction; {nodes} {none}")
    assert verified(tmp_path, declared).verdict == "refuted"
    longer = ("SETTLED: duration = 30ms", "SETTLED: duration = 32ms")
    module_result = verified(tmp_path, declared, longer)["SafePlanner"]
    assert module_result.verdict == "proved"
    assert module_result.findings["P1c"].verdict == "proved"


@pytest.mark.long
def test_a_response_delays_what_is_published(tmp_path: Path) -> None:
    declared = ("induction;", "induction; response sc 2ms;")
    phase = ("Follower period 10ms", "Follower period 10ms phase 1ms")
    assert verified(tmp_path, declared, phase).verdict == "refuted"
    longer = ("SETTLED: duration = 30ms", "SETTLED: duration = 32ms")
    assert verified(tmp_path, declared, phase, longer).verdict == "proved"


@pytest.mark.parametrize("settled", some(["30ms", "20ms", "32ms"], 2))
@pytest.mark.parametrize("node", ["Follower", "RRTStar"])
def test_what_a_node_takes_counts_as_its_response(tmp_path: Path, node: str, settled: str) -> None:
    longer = ("SETTLED: duration = 30ms", f"SETTLED: duration = {settled}")
    said = verified(tmp_path, longer, ("induction;", f"induction; response {node} 9ms;"))
    takes = (f"node {node} period 10ms {{", f"node {node} period 10ms {{ takes [1ms, 9ms];")
    report = verified(tmp_path, longer, takes)
    kinds = [
        {k for k, f in x["SafePlanner"].findings.items() if f.verdict == "proved"}
        for x in (report, said)
    ]  # a run that refutes may need a step that takes less than it says
    assert kinds[0] == kinds[1]


def test_an_ac_that_takes_longer_than_its_period_is_not_proved(tmp_path: Path) -> None:
    takes = ("node RRTStar period 10ms {", "node RRTStar period 10ms { takes [1ms, 11ms];")
    with pytest.raises(SoterError, match="R015"):
        verified(tmp_path, takes)


LIST_PREDICATE = """const HOVER: Plan = { ends: [], n: 0 };
fun PhiPlan(p: Plan): bool {
  for x in p.ends { if x > 0.5 { return false; } }
  return true;
}"""
SET = " in { ends in [0.0, 1.0], n in [0, 9] };"
ENUM = "type Plan = enum { Hover, Around, ThroughBuilding };"
VALUES = (
    (ENUM, "type Plan = { ends: float[<=4], n: int in [0, 9] };"),
    ("fun PhiPlan(p: Plan): bool { return p != Plan.ThroughBuilding; }", LIST_PREDICATE),
    ("topic candidate: Plan;", f"topic candidate: Plan{SET}"),
    ("topic inForce: Plan;", f"topic inForce: Plan{SET}"),
    ("if choose bool { publish candidate = choose Plan; }", "publish candidate = HOVER;"),
    ("Plan.Hover", "HOVER"),
    ("  var plan: Plan;\n", ""),
    (
        "plan = candidate;\n    }\n    publish inForce = plan;",
        "publish inForce = candidate;\n    }",
    ),
    ("topic inForce: Plan in", "topic inForce: Plan in"),
)


def test_predicates_may_read_ages_and_modes(tmp_path: Path) -> None:
    ttf = ("ttf !PhiPlan(candidate)", "ttf !PhiPlan(candidate) && age(candidate) >= 0.0")
    safer = ("safer PhiPlan(candidate)", "safer PhiPlan(candidate) && mode(SafePlanner) == Mode.SC")
    module_result = verified(tmp_path, ttf, safer)["SafePlanner"]
    assert module_result.verdict == "proved"
    assert module_result.findings["DM"].verdict == "assumed"


def test_a_predicate_of_lists_is_uninterpreted(tmp_path: Path) -> None:
    known = ("induction;", "induction; lemma PhiPlan(HOVER);")
    module_result = verified(tmp_path, *VALUES, known, refute=False)["SafePlanner"]
    assert module_result.verdict in ("proved", "undecided")
    assert module_result.findings["P2a"].verdict != "refuted"


SYSTEM = "system Planning default {"
FLOWN = "publish inForce = plan;"
SC = "  publishes candidate;\n  step { publish candidate = Plan.Hover; }"
RESTS = """  publishes candidate;
  var k: int in [0, 4];
  step { if k == 0 { publish candidate = Plan.ThroughBuilding; } k = (k + 1) % 5; }"""
SPARE = "node Spare period 50ms { publishes spare; step { publish spare = choose Plan; } }"
COUNT = "n = n + 1; publish inForce = plan;"
SECOND = "k = (k + 1) % 10; publish inForce = k > 8 ? candidate : plan;"
BAD = " = Plan.ThroughBuilding;"
WRONG = {
    "the threshold is what DM and SC take": [("= 30ms", "= 20ms")],
    "it is half of that": [("= 30ms", "= 10ms")],
    "no threshold": [("= 30ms", "= 0ms")],
    "not strict": [("age(candidate) >", "age(candidate) >=")],
    "the follower ignores the age": [("if age(candidate) > seconds(SETTLED) {", "if true {")],
    "SC publishes a bad plan, and rests": [(SC, RESTS)],
    "SC is silent": [("publish candidate = Plan.Hover;", "")],
    "SC is as slow as the DM": [("HoverPlan period 10ms", "HoverPlan period 20ms")],
    "a shorter threshold without the phase": [("= 30ms", "= 29ms")],
    "the DM is slower": [("  period 20ms;", "  period 40ms;")],
    "the DM looks at the plan in force": [("ttf !PhiPlan(candidate)", "ttf !PhiPlan(inForce)")],
    "the DM never looks": [("ttf !PhiPlan(candidate)", "ttf false")],
    "safer lets a bad plan in": [
        ("safer PhiPlan(candidate)", "safer true"),
        ("publish candidate = Plan.Hover;", ""),
    ],
    "a second way around the follower": [
        ("publishes inForce;\n  var", "publishes inForce;\n  var k: int in [0, 9];\n  var"),
        (FLOWN, SECOND),
    ],
    "a lemma that is false": [("induction;", "induction; lemma PhiPlan(candidate);")],
    "a lemma about too short a time": [
        ("induction;", "induction; lemma PhiPlan(candidate) || age(candidate) <= 0.01;")
    ],
    "DM, SC and follower late": [("induction;", "induction; late dm 5ms, sc 5ms, Follower 5ms;")],
    "the plan in force begins bad": [
        ("topic inForce: Plan;", f"topic inForce: Plan{BAD}"),
        ("  var plan: Plan;", f"  var plan: Plan{BAD}"),
    ],
    "another node publishes what is flown": [
        ("  subscribes candidate;", "  subscribes candidate, spare;"),
        ("topic inForce: Plan;", "topic inForce: Plan; topic spare: Plan;"),
        (FLOWN, "publish inForce = age(spare) < 0.001 ? spare : plan;"),
        (SYSTEM, f"{SPARE}\n{SYSTEM} node Spare;"),
    ],
    "a step that faults": [
        (FLOWN, COUNT),
        ("  var plan: Plan;", "  var plan: Plan;\n  var n: int in [0, 20];"),
    ],
}
NOT_REFUTED = {"a lemma that is false", "a lemma about too short a time"}
"""Undecided: a lemma is no property of the program."""


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_planner_is_never_proved(tmp_path: Path, name: str) -> None:
    report = verified(tmp_path, *WRONG[name])
    assert report.verdict in ("refuted", "undecided")
    assert report["SafePlanner"].findings["P2a"].verdict != "proved"
    if name not in NOT_REFUTED:
        assert report.verdict == "refuted", report["SafePlanner"].findings["P2a"].text


HOVER_NODE = "node HoverPlan period 10ms {\n" + SC + "\n}"
HOVER_EXTERN = 'extern node HoverPlan period 10ms from "c:a.c:f" { publishes candidate; }'
DM = "  ttf !PhiPlan(candidate);\n  safer PhiPlan(candidate);\n"


@pytest.mark.parametrize(
    ("code", "change"),
    [
        ("R031", ("induction;", "induction; horizon 50ms;")),
        ("R031", ("induction;", "induction; age 50ms;")),
        ("R031", ("induction;", "induction; late Nobody 1ms;")),
        ("R031", ("verify { induction; }", "verify { lemma PhiPlan(inForce); }")),
        ("R032", (DM, "")),
        ("R015", ("induction;", "induction; late Follower 11ms;")),
        ("R003", (HOVER_NODE, HOVER_EXTERN)),
    ],
)
def test_what_induction_is_not_for_is_a_diagnostic(
    tmp_path: Path, code: str, change: tuple[str, str]
) -> None:
    with pytest.raises(SoterError) as error:
        verified(tmp_path, change)
    assert code in {d.code for d in error.value.diagnostics}


def test_without_the_solver_there_is_a_word_about_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(SoterError) as error:
        verified(tmp_path)
    assert error.value.diagnostics[0].code == "D007"
    assert "soter-rta[prove]" in error.value.diagnostics[0].helps[0]


def test_monitors_and_advice_want_sets(tmp_path: Path) -> None:
    path = tmp_path / "planner.soter"
    path.write_text(PLANNER)
    for ask in (
        soter.load(path).advise,
        lambda: soter.load(path).emit_monitor(tmp_path / "m.soter"),
    ):
        with pytest.raises(SoterError) as error:
            ask()
        assert error.value.diagnostics[0].code == "R031"


EVERYTHING = """soter 1;
type Kind = enum { Hover, Go, Bad };
type Plan = { kind: Kind, n: int in [0, 9], ends: float[<=4], cost: float };
topic candidate: Plan in { n in [0, 9], ends in [-1.0, 1.0], cost in [0.0, 9.0] } max_age 200ms;
topic inForce: Plan in { n in [0, 9], ends in [-1.0, 1.0], cost in [0.0, 9.0] };
topic pose: float max_age 50ms;
topic u: float in [-1.0, 1.0];
topic alarm: bool;
topic beat: int in [0, 100];
fun far(p: Plan): bool { for e in p.ends { if e > 0.5 { return true; } } return false; }
fun good(p: Plan): bool { return p.kind != Kind.Bad && !far(p); }
const HOVER: Plan = { kind: Kind.Hover, n: 0, ends: [], cost: 0.0 };
extern node Any period 10ms { publishes candidate; }
node Safe period 10ms {
  subscribes pose, beat;
  publishes candidate;
  var k: int in [0, 3];
  var seen: float;
  on takeover { k = 0; }
  step {
    k = in_control ? min(k + 1, 3) : 0;
    seen = pose;
    let kind = seen > 3.0 ? Kind.Hover : Kind.Go;
    let h: Plan = { kind: kind, n: min(abs(beat), 9), ends: [], cost: 0.0 };
    publish candidate = beat > 3 ? h : HOVER;
  }
}
node Follower period 10ms {
  subscribes candidate, alarm queue 4;
  publishes inForce;
  step {
    var any = false;
    for a in alarm { any = any || a; }
    if age(candidate) > seconds(40ms) && good(candidate) && !any { publish inForce = candidate; }
  }
}
node Beat period 20ms { publishes beat, alarm; var n: int in [0, 100]; var f: bool[20];
  step {
    n = (n + 1) % 100;
    f[n % 20] = fair choose bool;
    publish beat = n / 7;
    publish alarm = f[3];
  }
}
plant Car period 5ms { reads u; drives pose = x; state x: float; der x = u; }
node Drive period 10ms {
  subscribes inForce;
  publishes u;
  step { publish u = clamp(inForce.cost, -1.0, 1.0); }
}
rta Planner {
  ac Any;
  sc Safe;
  period 20ms;
  safe good(inForce) && age(inForce) >= 0.0;
  ttf !good(candidate) || pose > 9.0;
  safer good(candidate) && mode(Planner) == Mode.SC;
  verify { induction;  }
}
system S default { node Follower; node Beat; node Drive; c: Car; module Planner; until 1s; }
"""
"""Records, lists, queues, modes, a fair choice, `on takeover`, an extern AC, a plant beside."""


@pytest.mark.long
def test_what_else_the_language_has_is_followed_or_left_open(tmp_path: Path) -> None:
    path = tmp_path / "everything.soter"
    path.write_text(EVERYTHING)
    module_result = load(path).verify(refute=False)["Planner"]
    assert module_result.verdict == "proved"
    assert any("pose: any value" in a for a in assumption_texts(module_result.assumptions))
    wrong = EVERYTHING.replace("&& good(candidate) && !any", "&& !any").replace("40ms", "20ms")
    path.write_text(wrong)
    assert load(path).verify(refute=False).verdict == "undecided"


@pytest.mark.long
def test_what_an_induction_rests_on_is_said_and_nothing_of_sets(tmp_path: Path) -> None:
    report = verified(tmp_path)
    assert any(
        a.startswith("z3 is right") for a in assumption_texts(report["SafePlanner"].assumptions)
    )
    report_page = proof_page(report)
    assert [symbol for symbol, _, _ in report_page.modules[0].times] == ["Δ", "δ"]
    assert any("z3" in line for line in report_page.trusted_base)
    assert not any("set engine" in line for line in report_page.trusted_base)
    said = " ".join(f"{row.meaning} {row.detail}" for row in report_page.modules[0].properties)
    assert "R(H)" not in said
    assert "core K" not in said


def opaque(tmp_path: Path, *changes: tuple[str, str]) -> ModuleResult:
    text = OPAQUE
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "opaque.soter"
    path.write_text(text)
    return load(path).verify(refute=False)["Planner"]


@pytest.mark.long
def test_what_is_opaque_is_named_and_no_assumption(tmp_path: Path) -> None:
    module_result = opaque(tmp_path)
    assert module_result.verdict == "proved"
    assert module_result.findings["P2a"].verdict == "proved"
    (note,) = module_result.notes
    assert "good" in note
    assert "made" in note
    assert not any("equal" in a for a in assumption_texts(module_result.assumptions))


@pytest.mark.long
def test_progress_is_assumed_and_printed(tmp_path: Path) -> None:
    module_result = opaque(tmp_path)
    returns = module_result.findings["P2b"]
    assert returns.verdict == "assumed"
    assert "`progress` holds" in returns.text
    assert "no step of Planner.Safe or Follower faults" in returns.text
    assert module_result.recover_s is None
    said = assumption_texts(module_result.assumptions)
    assert any(a.startswith("progress") and "made(asked)" in a for a in said)
    assert any("Follower faults" in a for a in said)


PROGRESS = "    progress fits(made(asked), asked);\n"


@pytest.mark.parametrize(
    "change",
    [
        (PROGRESS, ""),
        (PROGRESS, "    progress good(made(asked));\n"),
        (PROGRESS, "    progress fits(made(asked), asked) && asked > 8 && asked < 3;\n"),
        (
            "told = asked;\n      waited",
            "told = asked;\n      if false { told = 1; }\n      waited",
        ),
        ("waited = waited < 5 ? waited + 1 : waited;", ""),
        ("|| waited == 5", "|| true"),
    ],
    ids=["none", "not enough", "contradicted", "as before", "said once", "said always"],
)
def test_without_progress_nothing_says_that_ac_gets_control_back(
    tmp_path: Path, change: tuple[str, str]
) -> None:
    """SC says it again: from any state a `told` that is wrong does not matter for long."""
    findings = opaque(tmp_path, change).findings
    assert findings["P2a"].verdict == "proved"
    expected = "assumed" if "if false" in change[1] or "true" in change[1] else "undecided"
    assert findings["P2b"].verdict == expected


@pytest.mark.whole
@pytest.mark.parametrize(
    "changes",
    [
        [("&& good(candidate) { now", "{ now")],
        [("good(candidate) { now", "good(now) { now")],
        [("good(candidate) { now = candidate;", "good(made(3)) { now = made(4);")],
        [("publish inForce = now", "publish inForce = candidate")],
        [("{ now = candidate; }", "{ now = candidate; now.ends[0] = 0.25; }")],
        [("{ now = candidate; }", "{ now = candidate; push now.ends, 0.25; }")],
        [("{ now = candidate; }", "{ now.ends = candidate.ends; now.n = 1; }")],
        [
            # what is published for ever after a fault counts, too
            ("  publishes inForce;\n", "  publishes inForce;\n  failsafe inForce = BAD;\n"),
            ("topic asked", "const BAD: Way = { ends: [1.0], n: 1 };\ntopic asked"),
            ("good(candidate) { now", "good(made(candidate.n)) && good(candidate) { now"),
        ],
    ],
    ids=["unchecked", "another", "two", "around", "element", "push", "parts", "fail-safe"],
)
def test_what_is_opaque_proves_nothing_wrong(
    tmp_path: Path, changes: list[tuple[str, str]]
) -> None:
    module_result = opaque(tmp_path, *changes)
    assert module_result.findings["P2a"].verdict == "undecided"
    assert module_result.verdict == "undecided"


@pytest.mark.long
def test_a_fail_safe_value_that_is_safe_does_no_harm(tmp_path: Path) -> None:
    module_result = opaque(
        tmp_path,
        ("  publishes inForce;\n", "  publishes inForce;\n  failsafe inForce = STILL;\n"),
        ("topic asked", "const STILL: Way = { ends: [1.0], n: 0 };\ntopic asked"),
        ("good(candidate) { now", "good(made(candidate.n)) && good(candidate) { now"),
    )
    assert module_result.findings["P2a"].verdict == "proved"


@pytest.mark.long
def test_floats_are_equal_as_floats_are_and_not_as_terms(tmp_path: Path) -> None:
    """NaN is not equal to itself, and -0.0 equals 0.0."""
    for changed in (
        ("good(candidate) {", "candidate.ends[0] == candidate.ends[0] {"),
        ("good(candidate) {", "(candidate.ends[0] != candidate.ends[0] || good(candidate)) {"),
    ):
        assert opaque(tmp_path, changed).findings["P2a"].verdict == "undecided"


@pytest.mark.long
def test_lists_of_other_things_are_other_lists(tmp_path: Path) -> None:
    """Two floats, and one pair of floats: as lists they have no length in common."""
    lists = """let a: float[<=2] = [candidate.ends[0], candidate.ends[1]];
    let b: Pair[<=2] = [{ x: candidate.ends[0], y: candidate.ends[1] }];
    if a.len + b.len > 5 { now.n = 3; }
    if true { now = candidate; }"""
    module_result = opaque(
        tmp_path,
        ("if age(candidate) > seconds(50ms) && good(candidate) { now = candidate; }", lists),
        ("topic asked", "type Pair = { x: float, y: float };\ntopic asked"),
    )
    assert module_result.findings["P2a"].verdict == "undecided"


@pytest.mark.long
def test_functions_have_names_of_their_own(tmp_path: Path) -> None:
    """`element` of the program is not what takes an element out of a list."""
    function = """fun element(xs: float[<=4], i: int): float {
  var x = 0.0;
  for k in 0..100 { x = x + float(i); }
  return x;
}
"""
    low = "element(candidate.ends, 2) < 0.5 && !(candidate.ends[2] < 0.5)"
    step = f"if {low} || good(candidate) {{ now"
    module_result = opaque(
        tmp_path,
        ("if age(candidate) > seconds(50ms) && good(candidate) { now", step),
        ("node Any", function + "node Any"),
    )
    assert module_result.findings["P2a"].verdict == "undecided"


def test_control_does_not_come_back_where_what_the_dm_reads_is_never_fresh(tmp_path: Path) -> None:
    """Nothing contradicts what takes for granted that which never is."""
    wind = (
        "topic wind: bool max_age {age};\n"
        "node Wind period {period} {{ publishes wind; step {{ {step} }} }}\n"
    )
    verdicts = []
    for age, period, step in (
        ("100ms", "10ms", "publish wind = false;"),
        ("100ms", "10ms", "if false { publish wind = false; }"),
        ("15ms", "40ms", "publish wind = false;"),
    ):
        text = PLANNER.replace(
            "rta SafePlanner", wind.format(age=age, period=period, step=step) + "rta SafePlanner"
        )
        for old, new in (
            ("ttf !PhiPlan(candidate);", "ttf !PhiPlan(candidate) || wind;"),
            ("safer PhiPlan(candidate);", "safer PhiPlan(candidate) && !wind;"),
            ("{ node Follower;", "{ node Follower; node Wind;"),
        ):
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "windy.soter"
        path.write_text(text)
        findings = load(path).verify(refute=False)["SafePlanner"].findings
        assert findings["P2a"].verdict == "proved"
        verdicts.append(findings["P2b"].verdict)
    assert verdicts == ["proved", "undecided", "undecided"]


NEVER = {
    "ttf a tautology": (
        ("ttf !PhiPlan(candidate)", "ttf candidate == Plan.Hover || candidate != Plan.Hover"),
        ("ttf", "AC never keeps control"),
    ),
    "ttf wherever safer": (
        ("ttf !PhiPlan(candidate)", "ttf candidate != Plan.Around || PhiPlan(candidate)"),
        ("ttf", "AC never keeps control"),
    ),
    "safer a contradiction": (
        ("safer PhiPlan(candidate)", "safer PhiPlan(candidate) && !PhiPlan(candidate)"),
        ("safer", "AC never has control"),
    ),
    "safer nowhere that SC leads": (
        ("safer PhiPlan(candidate)", "safer candidate == Plan.Around"),
        ("safer", "AC never has control"),
    ),
    "safe a tautology": (
        ("safe PhiPlan(inForce)", "safe PhiPlan(inForce) || !PhiPlan(inForce)"),
        ("safe", "`safe` holds of all values"),
    ),
    "safe of nothing": (("safe PhiPlan(inForce)", "safe 1 < 2"), ("safe", "reads no topic")),
}


@pytest.mark.parametrize("name", NEVER)
def test_a_proof_of_nothing_says_so_in_its_headline(tmp_path: Path, name: str) -> None:
    """By what the solver shows of every decision, whatever the predicates look like."""
    change, (what, said) = NEVER[name]
    given_up = () if "safer" not in name else (("safer", "returns never;\n  safer"),)
    module_result = verified(tmp_path, change, *given_up)["SafePlanner"]
    assert module_result.verdict == "proved", module_result.findings
    vacuity = module_result.vacuity
    assert vacuity is not None
    assert (vacuity.how_often, vacuity.what) == ("never", what)
    assert said in module_result.headline


def test_a_proof_that_says_something_has_no_such_words(tmp_path: Path) -> None:
    """Where AC may only rarely have control, the solver finds when."""
    assert verified(tmp_path)["SafePlanner"].vacuity is None
    only = ("ttf !PhiPlan(candidate)", "ttf candidate != Plan.Hover")
    assert verified(tmp_path, only)["SafePlanner"].vacuity is None
