"""`polytope` lines of a `verify` block: what is proved holds in simulation; wrong ones are not."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.api import load
from soter.certificate.rechecker import recheck
from soter.language.front_end import check_file, system_of
from soter.monitor.linear_model import Plants
from soter.verify import verify_module as verifying
from soter.verify.claims.results import ModuleResult, PolytopePart
from soter.verify.deploy.missing_predicates import complete
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.polytope.claims import why_not
from soter.verify.polytope.extract_group import NotLinearError, linear_group
from soter.verify.polytope.half_spaces import LinearProgram, Polytope
from soter.verify.polytope.matrices import exact, exponential
from soter.verify.polytope.proofs import Claims
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import texts
from soter.verify.refute import refute
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from soter.verify.claims.case import Failure
    from soter.verify.polytope.matrices import Array
    from soter.verify.problem.problem import Problem

pytest.importorskip("highspy")

MS = 1_000_000
LIFT = Path(__file__).parents[4] / "examples" / "wall" / "lift.soter"

CART = """soter 1;
const A: float = 5.0;
const WALL: float = 1.5;
type Motion = { x: float, v: float };
topic motion: Motion max_age 10ms;
input topic goal: float in [-2.0, 2.0] = 1.9;
topic accel: float in [-A, A] = 0.0;
plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.02, motion.v within 0.05;
}
node Fast period 10ms {
  subscribes motion, goal;
  publishes accel;
  step { publish accel = clamp(9.0 * (goal - motion.x) - motion.v, -A, A); }
}
node Careful period 20ms {
  subscribes motion;
  publishes accel;
  step { publish accel = clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A); }
}
rta SafeCart {
  ac Fast;
  sc Careful;
  period 20ms;
  safe abs(motion.x) < WALL;
  ttf abs(motion.x) > 0.7 || abs(motion.v) > 0.8;
  safer abs(motion.x) < 0.6 && abs(motion.v) < 0.7;
  verify {
    polytope motion.x in [-WALL, WALL], motion.v in [-6.0, 6.0];
    late dm 1ms, sc 1ms;
  }
}
system Protected default { c: Cart; module SafeCart; }
"""
COMPUTED = (
    ("  ttf abs(motion.x) > 0.7 || abs(motion.v) > 0.8;\n", ""),
    ("  safer abs(motion.x) < 0.6 && abs(motion.v) < 0.7;\n", ""),
)
LAW = "clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A)"


def problem_of(*changes: tuple[str, str], text: str = CART) -> Problem:
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    checked = check_file("polytope.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


@lru_cache(maxsize=32)
def result_of(*changes: tuple[str, str]) -> ModuleResult:
    return verify_module(problem_of(*changes), refute=False)


def failures_of(*changes: tuple[str, str]) -> list[Failure]:
    """What stands against the claims about sets, without the check of the compiled DM."""
    problem = problem_of(*changes)
    library, _ = library_of(problem)
    (case,) = verifying._all_cases(problem, library)
    return case.failures


@lru_cache(maxsize=1)
def lift() -> ModuleResult:
    """The sets of the lift, and what stands against its claims: nothing."""
    problem = problem_of(text=LIFT.read_text())
    library, _ = library_of(problem)
    (case,) = verifying._all_cases(problem, library)
    assert not case.failures, case.failures
    return ModuleResult(problem, {}, [case.sets])


def part_of(result: ModuleResult) -> PolytopePart:
    (part,) = result.cases[0].polytopes
    return part


def verdicts(result: ModuleResult) -> dict[str, str]:
    return {name: f.verdict for name, f in result.findings.items()}


# ---------------------------------------------------------------- why nothing is proved

FOLLOWING = (
    ("v: float };", "v: float, b: float };"),
    ("drives motion = { x: x, v: v };", "drives motion = { x: x, v: v, b: b }; state b: float;"),
    ("wind: float in [-0.2, 0.2];", "wind: float in [-0.2, 0.2]; der b = 2.0 * (accel - b);"),
    ("motion.v in [-6.0, 6.0]", "motion.v in [-6.0, 6.0], motion.b in [-5.0, 5.0]"),
)
"""The cart below an autopilot that takes speeds: b is the speed it means to have."""
FORWARD = "der v = accel + wind;"


FOLLOWING_LAW = (LAW, "clamp(-0.3 * motion.x - 0.2 * motion.b, -A, A)")


def pulled(pull: float) -> tuple[tuple[str, str], ...]:
    """A cart that is pulled to b with `pull`, in 1/s."""
    rate = f"der v = 2.0 * (accel - b) + {pull} * (b - v) + wind;"
    return (*FOLLOWING, *COMPUTED, (FORWARD, rate), FOLLOWING_LAW)


@pytest.mark.long
def test_a_plant_that_nothing_pulls_back_is_shown_to_leave() -> None:
    result = verify_module(problem_of(*pulled(0.0)), refute=False, explain=True)
    p2a = result.findings["P2a"]
    assert p2a.text.startswith("K is empty: under SC a run of the model leaves ")
    assert p2a.leaving is not None
    follows = verify_module(problem_of(*pulled(6.0)), refute=False, explain=True)
    assert follows.findings["P2a"].verdict == "proved"


def test_a_small_share_of_the_ranges_is_said_with_what_makes_it_larger() -> None:
    wide = result_of(*COMPUTED, ("motion.v in [-6.0, 6.0]", "motion.v in [-40.0, 40.0]"))
    note, *_ = wide.notes
    assert 0.0 < wide.shares["core"] < 0.2
    assert f"SC keeps c.x, c.v on {wide.shares['core']:.1%} of their ranges only" in note
    assert wide.verdict == "proved", "it is a note"
    assert all("scheme" in note for note in result_of(*COMPUTED).notes)


def test_the_axis_is_named_on_which_a_bound_is_missed_most() -> None:
    lines = Polytope(np.array([-1.0, -1.0]), np.ones(2), np.zeros((0, 2)), np.zeros(0))
    group = problem_of().groups[0]

    def missed(row: list[float]) -> str:
        def prove() -> None:
            Claims().holds("K", lines, exact(np.array([[0.1, 0.0], row])), np.array([1.0, 0.5]))

        return why_not(prove, group)

    assert missed([1.0, 0.0]) == "K: exceeded by 0.5, most in c.x at its upper end"
    assert missed([1.0, -0.9]) == "K: exceeded by 1.4, most in c.v at its lower end"
    assert missed([0.0, 0.4]) == ""


# ---------------------------------------------------------------- what is proved


def test_a_polytope_group_is_proved_with_predicates_of_the_user() -> None:
    module_result = result_of()
    assert module_result.verdict == "proved", module_result.findings
    assert module_result.findings["ttf"].counts["boxes"] > 1
    assert module_result.recover_s is not None
    assert (
        0
        < module_result.shares["gives_back"]
        < module_result.shares["lets_ac"]
        < module_result.shares["free"]
    )
    assert module_result.shares["free"] < module_result.shares["core"]


def test_the_scheme_of_the_simulator_is_part_of_the_proof() -> None:
    assert not any("Runge" in a or "scheme" in a for a in texts(result_of().assumptions))
    model = part_of(result_of()).model
    assert model is not None
    assert model.covers_scheme


@pytest.mark.long
def test_computed_predicates_are_proved_and_compiled() -> None:
    module_result = result_of(*COMPUTED)
    assert module_result.verdict == "proved", verdicts(module_result)
    assert "points at borders" in module_result.findings["DM"].text
    (note,) = complete(problem_of(*COMPUTED).system)
    assert f"on {module_result.shares['estimates']:.1%} of the estimates (S_0)" in note
    assert (
        0
        < module_result.shares["gives_back"]
        < module_result.shares["lets_ac"]
        < module_result.shares["free"]
    )


def test_the_lift_is_proved() -> None:
    sets = part_of(lift()).sets
    assert sets is not None
    assert len(sets.allowed) == 2
    assert sets.kept is not None
    crossing = np.array([[0.0, 1.0, 0.0, 0.0]])
    assert sets.safer.contains(crossing).all(), "AC gets control back at 1 m/s"


# ---------------------------------------------------------------- what is wrong is not


WRONG = {
    "a gain that is too weak": ((LAW, "clamp(-0.02 * motion.x - 0.01 * motion.v, -A, A)"),),
    "a sign that is flipped": ((LAW, "clamp(2.0 * motion.x - 2.5 * motion.v, -A, A)"),),
    "a law with a dead zone": (
        (LAW, "abs(motion.x) < 0.3 ? 0.0 : clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A)"),
    ),
    "larger errors": (("motion.v within 0.05", "motion.v within 0.6"),),
    "a stronger wind": (("in [-0.2, 0.2]", "in [-2.5, 2.5]"),),
    "an old read": (("max_age 10ms", "max_age 400ms"),),
    "a nearer wall": (("safe abs(motion.x) < WALL", "safe abs(motion.x) < 0.6"),),
    "a bolder ttf": (("abs(motion.x) > 0.7 ||", "abs(motion.x) > 1.4 ||"),),
    "a ttf that forgets speed": ((" || abs(motion.v) > 0.8", ""),),
    "a bolder safer": (("abs(motion.x) < 0.6 &&", "abs(motion.x) < 1.4 &&"),),
    "a longer horizon": (("late dm 1ms", "horizon 150ms; late dm 1ms"),),
    "a start too close to the wall": (
        (
            "state x: float = 0.0;\n  state v: float = 0.0",
            "state x: float = 1.4; state v: float = 0.9",
        ),
    ),
    "a start that is too fast": (("state v: float = 0.0", "state v: float = 5.9"),),
    "a `safer` that SC does not reach": (
        ("abs(motion.x) < 0.6 && abs(motion.v) < 0.7", "abs(motion.x) < 0.01"),
    ),
}
FAILS = {
    "a bolder ttf": {"ttf"},
    "a ttf that forgets speed": {"ttf"},
    "a bolder safer": {"safer"},
    "a start too close to the wall": {"start"},
    "a start that is too fast": {"start"},
    "a `safer` that SC does not reach": {"P2b"},
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_undecided(name: str) -> None:
    failures = failures_of(*WRONG[name])
    failed = {f.claim for f in failures}
    assert failed, name
    assert FAILS.get(name, failed) <= failed
    assert failures[0].hint, name


@pytest.mark.long
def test_predicates_that_forget_the_errors_are_not_proved() -> None:
    """A set that lies in S_0 of exact estimates, written as the user's: `ttf` and nothing else."""
    measured = "  measured motion.x within 0.02, motion.v within 0.05;\n"
    bold = (
        "abs(motion.x) > 0.7 || abs(motion.v) > 0.8",
        "abs(motion.x) > 1.1 || abs(motion.v) > 0.8",
    )
    assert "ttf" not in {f.claim for f in failures_of(bold, (measured, ""))}
    assert "ttf" in {f.claim for f in failures_of(bold)}


def test_a_map_is_left_to_grids() -> None:
    changes = (
        (
            "der x = v;\n  der v = accel + wind;",
            "next x = x + 0.005 * v; next v = v + 0.005 * accel;",
        ),
        ("max_age 10ms", "max_age 4ms"),
    )
    (first, *_) = failures_of(*changes)
    assert first.claim == "P2a"
    assert "map" in first.text


def test_states_in_topics_of_different_ages_are_no_one_estimate() -> None:
    changes = (
        ("topic motion: Motion max_age 10ms;",
         "topic motion: Motion max_age 10ms; topic speed: float max_age 10ms;"),
        ("measured motion.x", "drives speed = v;\n  measured motion.x"),
        ("node Careful period 20ms {\n  subscribes motion;",
         "node Careful period 20ms {\n  subscribes motion, speed;"),
        ("- 2.5 * motion.v, -A, A)", "- 2.5 * speed, -A, A)"),
    )  # fmt: skip
    problem = problem_of(*changes)
    library, _ = library_of(problem)
    limits = [(-1.5, 1.5), (-6.0, 6.0)]
    with pytest.raises(NotLinearError, match="different ages"):
        linear_group(problem, CompiledEnclosures(library, problem, ()), problem.groups[0], limits)


def hidden(limit: float) -> tuple[tuple[str, str], ...]:
    """A lag between command and acceleration, whose state no topic shows."""
    return (
        *COMPUTED,
        ("state v: float = 0.0;", "state v: float = 0.0;\n  state f: float = 0.0;"),
        ("der v = accel + wind;", "der v = f + wind;\n  der f = 40.0 * (accel - f);"),
        ("[-6.0, 6.0];", f"[-6.0, 6.0], c.f in [-{limit}, {limit}];"),
    )


def test_a_state_that_no_topic_shows_is_named() -> None:
    failures = failures_of(*hidden(5.2))
    assert {f.claim for f in failures} == {"ttf", "safer", "P2b"}
    assert "c.f" in failures[0].text
    assert "write `ttf` and `safer`" in failures[0].hint


def test_a_range_that_commands_leave_soon_leaves_ac_nothing() -> None:
    (first, *_) = failures_of(*hidden(4.0))
    assert first.claim == "ttf"
    assert "R(H) is empty" in first.text


# ---------------------------------------------------------------- the numbers


def test_the_matrices_enclose_the_plant_and_the_law() -> None:
    problem = problem_of(text=LIFT.read_text())
    library, _ = library_of(problem)
    forms = CompiledEnclosures(library, problem, ())
    limits = [(r.low, r.high) for r in problem.states]
    group = linear_group(problem, forms, problem.groups[0], limits).group
    plants, rng = Plants(problem), np.random.default_rng(1)
    low, high = np.array(limits).T
    linear = 0
    for _ in range(300):
        x = rng.uniform(low, high)
        u, w = rng.uniform(-5.0, 5.0, 1), rng.choice([-0.4, 0.4], 1)
        rest = plants.rates(x, u, w, ()) - group.state @ x - group.control @ u
        assert (rest >= group.drift_low - 1e-12).all()
        assert (rest <= group.drift_high + 1e-12).all()
        z = group.gain @ x + group.offset
        box = forms.whole.copy()
        box[:4] = x[:, None]
        box[6:] = 0.0
        told = forms.numbers("law", box, 1)
        assert told is not None
        if group.law_low[0] <= z[0] <= group.law_high[0]:
            linear += 1
            assert abs(told.mean() - z[0]) <= group.remainder[0] + 1e-12
    assert linear > 20
    assert group.law_high[0] > 4.99
    assert (group.error[:2] >= [0.03, 0.05]).all()
    assert (group.error[:2] <= [0.0301, 0.0501]).all()
    assert (group.control_low[0], group.control_high[0]) == (-5.0, 5.0)
    assert (group.delta_ns, group.delay_ns, group.jitter_ns) == (20 * MS, 12 * MS, 3 * MS)


def test_a_clamp_that_is_tighter_than_the_set_limits_the_linear_part() -> None:
    problem = problem_of((LAW, "clamp(-2.0 * motion.x - 2.5 * motion.v, -3.0, 4.0)"))
    library, _ = library_of(problem)
    limits = [(-1.5, 1.5), (-6.0, 6.0)]
    group = linear_group(
        problem, CompiledEnclosures(library, problem, ()), problem.groups[0], limits
    ).group
    assert -3.0 - 1e-4 <= group.law_low[0] <= -2.9
    assert group.law_high[0] <= 4.0 + 1e-4
    assert group.remainder[0] < 1e-4


# ---------------------------------------------------------------- adversaries


def extreme(p: Polytope, count: int, rng: np.random.Generator) -> Array:
    """Points of the border in random directions."""
    program = LinearProgram(p)
    width = p.high - p.low
    points = [program.greatest(rng.normal(size=len(p.low)) / width)[1] for _ in range(count)]
    return np.array(points) * (1 - 1e-9)


def closed_loop(result: ModuleResult, allowed: Polytope, safer: Polytope, seconds: float) -> int:
    """Runs of DM and SC against an AC and a world that mean harm; how many leave C.

    1 ms apart, exact in between; ages, lateness and responses drawn up to their bounds.
    """
    group, times = part_of(result).sets.group, result.problem.times  # type: ignore[union-attr]
    rng = np.random.default_rng(7)
    x = np.concatenate([extreme(allowed, 150, rng), np.zeros((150, len(group.low)))])
    n = len(x)
    e, g = (m.mid for m in exponential(group.state, MS))
    age_max = max(times.age_dm, times.age_sc) // MS
    late = times.jitter_sc // MS
    delta_sc, delta_dm = times.delta_sc // MS, times.delta_dm // MS
    past = [x] * (age_max + 1)
    mode = np.ones(n, dtype=bool)
    command = np.zeros((n, 1))
    coming: list[tuple[int, Array, Array]] = []
    out = np.zeros(n, dtype=bool)
    bias = rng.choice([-1.0, 1.0], (n, len(group.low))) * group.error
    push = rng.choice([-1.0, 1.0], (n, 1))
    wind = np.where(rng.random((n, 1)) < 0.5, group.drift_low, group.drift_high)

    def estimate() -> Array:
        age = rng.integers(0, age_max + 1)
        flip = np.where(rng.random((n, 1)) < 0.5, 1.0, rng.choice([-1.0, 1.0], (n, 1)))
        return past[-1 - int(age)] + bias * flip

    for t in range(int(seconds * 1000)):
        if t % delta_dm == 0:
            seen = estimate()
            mode = np.where(mode, allowed.contains(seen), safer.contains(seen))
        if t % delta_sc == 0:
            u = np.clip(estimate() @ group.gain.T + group.offset, -5.0, 5.0)
            coming.append((t + int(rng.integers(0, late + 1)), u, mode.copy()))
        while coming and coming[0][0] <= t:
            _, u, _ = coming.pop(0)
            command = u
        push = np.where(rng.random((n, 1)) < 0.01, rng.choice([-1.0, 1.0], (n, 1)), push)
        toward = np.sign(x[:, :1] + 0.3 * x[:, 1:2])
        worst = np.where(np.arange(n)[:, None] % 2 == 0, toward, push) * group.control_high
        acting = np.where(mode[:, None], worst, command)
        gust = np.where(np.sign(x[:, 1:2]) > 0, group.drift_high, group.drift_low)
        wind = np.where(rng.random((n, 1)) < 0.02, gust, wind)
        x = x @ e.T + (acting @ group.control.T + wind) @ g.T
        past = [*past[1:], x]
        out |= (np.abs(x) > group.high).any(axis=1)
    return int(out.sum())


def test_nobody_escapes_from_the_lift() -> None:
    sets = part_of(lift()).sets
    assert sets is not None
    assert closed_loop(lift(), sets.allowed[0], sets.safer, 12.0) == 0


def test_the_simulation_would_notice_sets_that_forget_the_horizon() -> None:
    sets = part_of(lift()).sets
    assert sets is not None
    assert closed_loop(lift(), sets.core, sets.core, 12.0) > 0


@pytest.mark.long
def test_runs_of_the_compiled_program_under_attack_find_nothing() -> None:
    checked = check_file("polytope.soter", "".join(_replaced(CART)))
    flat = system_of(checked, None)
    notes = complete(flat)
    assert "computed" in notes[0], notes
    search = refute(flat, "SafeCart", budget_s=2.0)
    assert search.found is None
    assert search.runs > 100


def _replaced(text: str) -> str:
    for old, new in COMPUTED:
        text = text.replace(old, new)
    return text


# ---------------------------------------------------------------- beside grids


MIXED = (
    ("type Motion = { x: float, v: float };", "type Motion = { x: float, v: float, z: float };"),
    ("{ x: x, v: v }", "{ x: x, v: v, z: z }"),
    ("state v: float = 0.0;", "state v: float = 0.0;\n  state z: float = 0.0;"),
    ("der v = accel + wind;", "der v = accel + wind;\n  der z = wind - z;"),
    ("late dm 1ms", "grid motion.z in [-0.5, 0.5] / 40; late dm 1ms"),
)


def test_a_polytope_stands_beside_a_grid() -> None:
    module_result = result_of(*MIXED)
    assert len(module_result.cases[0].groups) == len(module_result.cases[0].polytopes) == 1
    assert module_result.verdict == "proved", {n: f.text for n, f in module_result.findings.items()}


def test_a_grid_that_fails_beside_a_polytope_is_not_proved() -> None:
    wrong = replace_in(MIXED, "der z = wind - z;", "der z = 0.2 + wind;")
    assert "P2a" in {f.claim for f in failures_of(*wrong)}


def test_a_constraint_that_mixes_the_groups_is_not_proved() -> None:
    mixed = ("safe abs(motion.x) < WALL;", "safe abs(motion.x + motion.z) < WALL;")
    assert failures_of(*MIXED, mixed)


def replace_in(
    changes: tuple[tuple[str, str], ...], old: str, new: str
) -> tuple[tuple[str, str], ...]:
    return tuple((a, b.replace(old, new)) for a, b in changes)


def test_a_coupling_between_groups_counts_as_disturbance() -> None:
    coupled = replace_in(MIXED, "der v = accel + wind;", "der v = accel + wind + 0.1 * z;")
    problem = problem_of(*coupled)
    library, _ = library_of(problem)
    limits = [(-1.5, 1.5), (-6.0, 6.0)]
    model = linear_group(
        problem, CompiledEnclosures(library, problem, ()), problem.groups[0], limits
    )
    assert model.group.drift_high[1] >= 0.2 + 0.1 * 0.5
    assert model.group.drift_high[1] < 0.3


# ---------------------------------------------------------------- what is written


def test_the_certificate_holds_the_polytopes_and_is_accepted(tmp_path: Path) -> None:
    source = tmp_path / "cart.soter"
    source.write_text(_replaced(CART))
    program = load(source)
    program.verify(cert=tmp_path / "cert", report=tmp_path / "proof.html", refute=False)
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    (group,) = manifest["modules"][0]["cases"][0]["groups"]
    assert group["kind"] == "polytope"
    rows, columns = group["K"]["faces"]["shape"]
    raw = (tmp_path / "cert" / group["K"]["faces"]["file"]).read_bytes()
    assert np.frombuffer(raw, dtype="<f8").reshape(rows, columns).shape == (rows, 3)
    assert set(group["multipliers"]) == {"K", "R", "S", "Q"}
    report = recheck(tmp_path / "cert", workers=1)
    assert report.accepted, report.reason
    assert report.safe
    assert report.returns
    page = (tmp_path / "proof.html").read_text()
    assert "drawn from half-spaces, by points" in page


def test_the_dm_and_the_interpreter_agree_on_every_state(tmp_path: Path) -> None:
    source = tmp_path / "cart.soter"
    source.write_text(_replaced(CART))
    program = load(source)
    runs = [
        program.simulate(until=4.0, engine=engine, trace=True) for engine in ("native", "interp")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert runs[0].modules["SafeCart"].switches_to_sc > 0


# ---------------------------------------------------------------- clamps within the law

CASCADE = "clamp(2.5 * (clamp(-0.8 * motion.x, -0.5, 0.5) - motion.v), -A, A)"


@pytest.mark.parametrize(
    "law",
    [
        CASCADE.replace("-0.8", "0.8"),
        CASCADE.replace("- motion.v", "+ motion.v"),
        CASCADE.replace("-0.5, 0.5", "0.1, 0.5"),
        CASCADE.replace("-0.5, 0.5", "-0.001, 0.001"),
    ],
)
def test_a_cascade_that_does_not_hold_is_not_proved(law: str) -> None:
    (first, *_) = failures_of(*COMPUTED, (LAW, law))
    assert first.claim == "P2a"


# ---------------------------------------------------------------- what is no verdict


@pytest.mark.parametrize("part", ["find_core", "prove_core", "prove_free", "find_return"])
def test_an_invariant_that_fails_is_a_defect_not_a_verdict(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("an invariant")

    monkeypatch.setattr(f"soter.verify.polytope.proofs.{part}", broken)
    with pytest.raises(AssertionError, match="an invariant"):
        failures_of()


def test_a_budget_that_is_used_up_is_undecided_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("soter.verify.polytope.proofs.WORK", (2_000,))
    (first, *_) = failures_of()
    assert first.claim == "P2a"
    assert "its budget is used up" in first.text
    assert "2,000 half-spaces" in first.text
    assert "damps more" in first.hint


def test_numbers_beyond_doubles_are_undecided() -> None:
    (first, *_) = failures_of(("der v = accel + wind;", "der v = 1.0e6 * v + accel + wind;"))
    assert first.claim == "P2a"
