"""Programs with `rest` and `shield;`: what gates say of commands, and where they move them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import Program
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import TypedCall
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck
from unit.verify.tubes.test_rest_claims import FOLLOW, SENSED, verified
from unit.verify.tubes.test_rest_programs import changed

if TYPE_CHECKING:
    from pathlib import Path

JUDGED = FOLLOW.read_text(encoding="utf-8").replace("  rest abs(", "  shield;\n  rest abs(")
Pair = tuple[float, float]
CELLS = 64
NEVER, NOW = -1e18, 5.0


def check_of(text: str) -> TubeCheck:
    flat = system_to_prove(check_file("module.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def test_what_is_proved_beforehand_does_not_hang_on_commands(tmp_path: Path) -> None:
    m = verified(tmp_path, JUDGED)
    said = {n: f.verdict for n, f in m.findings.items()}
    assert (m.verdict, said["P2a"], said["start"]) == ("assumed", "proved", "proved")
    assert "a command acts only where" in m.findings["P3"].text
    assert m.not_rechecked == ""


def test_a_command_is_judged_with_those_that_may_still_act() -> None:
    """A train at 20 m/s, 12.4 m from one that stands: 10 m to brake, and what it comes to."""
    caller = Caller(check_of(JUDGED).text_in_flight({2: Interval(-0.31, 0.31)}))
    gas, brake, near = (1.0, 0.0), (0.0, 1.0), (12.4, 0.0, 20.0)

    def permits(own: Pair, held: Pair | None = None, since: float = NOW) -> bool:
        until = [NEVER] * (2 * CELLS)
        for k, u in enumerate(held or ()):
            until[CELLS * k + min(CELLS - 1, int(u * CELLS))] = NOW
        return caller.returns_true("judged", near, own, tuple(until), since)

    assert permits(brake)
    assert not permits(gas)
    assert not permits(gas, brake)
    assert not permits(brake, gas)
    assert permits(brake, gas, NOW + 1e-9)  # which was held too long ago
    assert not caller.returns_true("good", near)
    assert not permits((-0.1, 1.0))
    assert not permits((0.0, 1.1))
    assert not permits((float("nan"), 1.0))


@pytest.mark.parametrize(
    ("within", "any_for", "acted"),
    [("", 0, 70), ("acts within 9ms;", 9, 79), ("acts within 4ms to 9ms;", 5, 79)],
)
def test_times_of_a_judged_command(within: str, any_for: int, acted: int) -> None:
    """W is H* less A, Delta and L_min; a command counts for A, L and a period of SC."""
    check = check_of(changed(JUDGED, ("within 5s;\n", f"within 5s;\n  verify {{ {within} }}\n")))
    assert check.times.any_command == any_for * 1_000_000
    assert check.problem.times.replaced_window == acted * 1_000_000


def test_a_shield_of_what_may_be_of_any_age_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SoterError) as caught:
        verified(tmp_path, changed(JUDGED, (" max_age 20ms;", ";")))
    assert caught.value.diagnostics[0].code == "R011"


def test_flights_are_safe_and_the_same_in_both_engines(tmp_path: Path) -> None:
    """AC does whatever its draws say; what is refused is a gate fault, and SC takes over."""
    path = tmp_path / "wild.soter"
    path.write_text(
        JUDGED.replace(
            "gas: clamp(wanted, 0.0, 1.0), brake: clamp(-wanted, 0.0, 1.0)",
            "gas: choose { 0.0, 1.0 }, brake: choose { 0.0, 0.05 }",
        ),
        encoding="utf-8",
    )
    program = Program(str(path))
    faults = 0
    for seed in (1, 2):
        run = program.simulate(until="30s", seed=seed)
        assert run.violations == 0
        assert 0.0 < run.modules["Follow"].ac_share < 1.0
        faults += run.modules["Follow"].gate_faults
    assert faults > 0
    near = changed(path.read_text(encoding="utf-8"), ("gap: float = 60.0", "gap: float = 2.0"))
    path.write_text(changed(near, ("v: float = 10.0", "v: float = 0.9")), encoding="utf-8")
    program = Program(str(path))
    one, two = (program.simulate(until="100ms", engine=e) for e in ("native", "interp"))
    assert one.trace_sha256 == two.trace_sha256
    assert one.modules["Follow"].ac_share > 0.0


def test_sc_that_reads_has_a_shield_too(tmp_path: Path) -> None:
    m = verified(tmp_path, SENSED.replace("  rest abs(", "  shield;\n  rest abs("))
    assert m.findings["start"].verdict == "proved"


# ---------------------------------------------------------------- moved commands

GENTLE = "let wanted = 0.5 * (30.0 - sight.v) + 0.1 * (sight.gap - 40.0);"
PUSHED = changed(JUDGED, (GENTLE, "let wanted = 1.0;"))
"""Full throttle at whatever stands in front."""
MOVED = changed(PUSHED, ("  shield;", "  shield toward sc;"))
NEAR = changed(
    MOVED,
    ("state gap: float = 60.0;", "state gap: float = 15.8;"),
    ("state v: float = 10.0;", "state v: float = 24.0;"),
)


GAS_AND_BRAKE = "topic gas: float in [0.0, 1.0] = 0.0;\ntopic brake: float in [0.0, 1.0] = 1.0;"


def flown(folder: Path, text: str, engine: str = "native", until: str = "30s") -> soter.Run:
    path = folder / "follow.soter"
    path.write_text(text, encoding="utf-8")
    return soter.load(path).simulate(seed=3, until=until, engine=engine)


def test_a_command_is_moved_to_the_first_on_the_way_that_may_act_for_longer() -> None:
    """At 30 m/s, d in front of what stands; no command that is told was not judged."""
    caller = tube_check_caller()
    gas, brake = (1.0, 0.0), (0.0, 1.0)

    def found(gap: float, *held: Pair) -> tuple[float, ...]:
        until = [NEVER] * (2 * CELLS)
        for u in held:
            for k, number in enumerate(u):
                until[CELLS * k + min(CELLS - 1, int(number * CELLS))] = NOW
        seen = gap, 200.0, 30.0
        answer: tuple[float, ...] = caller.result("toward", seen, (*gas, *brake), tuple(until), NOW)
        if answer[2] == 1.0:
            assert caller.returns_true("judged", seen, answer[:2], tuple(until), NOW)
        return answer

    assert found(40.0) == (1.0, 0.0, 1.0)
    shares = [found(gap)[0] for gap in (22.0, 21.0, 20.0, 19.0, 18.0)]
    assert shares == sorted(shares, reverse=True)
    assert 0.0 < shares[2] < 1.0
    assert found(20.0, gas) == (
        0.0,
        1.0,
        1.0,
    )  # what was held may still act: SC's, before it is late
    assert found(18.0, gas) == (1.0, 0.0, 0.0)  # it is
    assert found(10.0) == (1.0, 0.0, 0.0)


def tube_check_caller() -> Caller:
    return Caller(check_of(MOVED).text_in_flight({2: Interval(-0.31, 0.31)}))


def test_both_engines_move_alike_and_nothing_is_hit(tmp_path: Path) -> None:
    runs = [flown(tmp_path, NEAR, e, "60ms") for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert runs[1].moved("Follow").any()
    assert not runs[1].violations


def test_an_ac_that_pushes_keeps_control_for_longer(tmp_path: Path) -> None:
    plain, moved = flown(tmp_path, PUSHED), flown(tmp_path, MOVED)
    assert not plain.violations
    assert not moved.violations
    assert moved.modules["Follow"].ac_share > plain.modules["Follow"].ac_share + 0.05
    assert moved.modules["Follow"].gate_faults < plain.modules["Follow"].gate_faults
    assert moved.moved_commands[0][1] > 50


def test_a_forced_module_neither_moves_nor_refuses(tmp_path: Path) -> None:
    forced = changed(NEAR, ("  module Follow;\n", "  module Follow;\n  force Follow ac;\n"))
    runs = [flown(tmp_path, forced, e, "700ms") for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].modules["Follow"].gate_faults
    assert (runs[1].array("levers.gas")[-20:] == 1.0).all()
    assert flown(tmp_path, forced).violations


def test_ac_alone_of_a_campaign_has_no_shield_either(tmp_path: Path) -> None:
    """From where `test_both_engines_move_alike_and_nothing_is_hit` begins, at full throttle."""
    path = tmp_path / "follow.soter"
    path.write_text(NEAR, encoding="utf-8")
    program = soter.load(path)
    flown = program.campaign(flights=1, until="30s", arms=("ac",), output=tmp_path / "c")
    assert [arm.flights[0].violations > 0 for arm in flown.arms] == [False, True]
    run = program.simulate(until="30s", arm="ac")
    assert (run.array("levers.gas")[20:] == 1.0).all()


def test_of_several_outputs_what_a_step_leaves_held_is_judged_with_what_it_publishes(
    tmp_path: Path,
) -> None:
    """AC publishes the gas alone: the brake that it last wished for acts no more than SC let it."""
    text = changed(
        NEAR,
        ("topic levers: Levers in [0.0, 1.0] = { gas: 0.0, brake: 1.0 };", GAS_AND_BRAKE),
        ("publishes levers;\n  step {\n    let", "publishes gas, brake;\n  step {\n    let"),
        ("publish levers = { gas: clamp(wanted, 0.0, 1.0), ", "publish gas = 1.0; // "),
        ("publishes levers;", "publishes gas, brake;"),
        ("publish levers = { gas: 0.0, brake: 1.0 };", "publish gas = 0.0; publish brake = 1.0;"),
        ("reads levers;", "reads gas, brake;"),
        ("levers.gas", "gas"),
        ("levers.brake", "brake"),
    )
    for program, judged in ((text, True), (NEAR, False)):
        shield = flown(tmp_path, program, until="20ms").system.modules[0].shield
        assert shield is not None
        calls = [x for x in nodes([shield.permits]) if isinstance(x, TypedCall)]
        assert any(x.fun.name == "judged" for x in calls) == judged


def test_what_is_proved_and_checked_again_is_that_of_judged_commands(tmp_path: Path) -> None:
    m = verified(tmp_path, MOVED, cert=tmp_path / "proof")
    assert (m.verdict, m.findings["P2a"].verdict, m.not_rechecked) == ("assumed", "proved", "")
    assert "a command acts only where" in m.findings["P3"].text
    checked = soter.recheck(tmp_path / "proof")
    assert checked.accepted, checked
