"""A brake as a fail-safe law: proved in stopping coordinates, and what is no such law is not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.api import recheck
from soter.language.front_end import check_file, system_of
from soter.verify.claims import claims
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.verify.claims.results import ModuleResult
    from soter.verify.grid.sets import GridGroup

    Floats = npt.NDArray[np.float64]

TEXT = (Path(__file__).parents[3] / "examples" / "wall" / "brake.soter").read_text("utf-8")
LAW = "failsafe command = { drive: 0.0, brake: 1.0 };"
B, MORE, SLOW = 4.0, 0.5, 0.2
STEP_NS = 100_000
STEPPED = 1e-6
"""How far a stepped run may be from the run."""
COARSE = (("ROOM] / 120", "ROOM] / 60"), ("FASTEST] / 55", "FASTEST] / 22"))


def text(*changes: tuple[str, str]) -> str:
    source = TEXT
    for old, new in (*COARSE, *changes):
        assert old in source, old
        source = source.replace(old, new)
    return source


def verified(source: str) -> ModuleResult:
    checked = check_file("brake.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return verify_module(extract(flat, flat.modules[0]), refute=False)


def kept_by_the_law(source: str) -> bool:
    """Whether K_fs has a cell in which the car moves: one at rest is kept by any law."""
    flat = system_of(check_file("brake.soter", source), None)
    law = extract(flat, flat.modules[0]).law
    assert law is not None
    case = claims.open_case(law, library_of(law)[0], law.groups, ())
    if not (claims.compute_constraint(case) and claims.compute_core(case)):
        return False
    (group,) = case.sets.groups
    edges = np.array(law.groups[0].axes[1].edges)
    return bool((group.core > 0)[:, edges[:-1] > 0.0].any())


@pytest.mark.long
def test_a_brake_of_uncertain_strength_is_a_law_that_is_proved_and_rechecked(
    tmp_path: Path,
) -> None:
    (tmp_path / "brake.soter").write_text(text())
    report = soter.load(tmp_path / "brake.soter").verify(cert=tmp_path / "cert", refute=False)
    (module,) = report.modules
    assert module.verdict == "proved"
    assert module.findings["failsafe"].verdict == "proved"
    recheck_report = recheck(tmp_path / "cert")
    assert recheck_report.accepted, recheck_report.reason
    assert "failsafe" in recheck_report.modules[0].confirmed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (LAW, "failsafe command = { drive: 0.0, brake: 0.0 };"),  # rolls on
        (LAW, "failsafe command = { drive: 0.0, brake: 0.99 };"),  # a bit less than the weakest
        ("float in [0.0, MORE]", "float in [-0.01, MORE]"),  # weaker than `room` counts with
        ("* more * speed", "* (more - 0.001) * speed"),  # creeps
    ],
)
def test_what_takes_room_away_is_no_law(old: str, new: str) -> None:
    assert not kept_by_the_law(text((old, new)))


def test_a_full_brake_needs_no_throttle_to_be_released() -> None:
    """The throttle acts through what the brake leaves: nothing. So any value of it is a law."""
    assert kept_by_the_law(text((LAW, "failsafe command = { drive: A, brake: 1.0 };")))


def test_with_its_safe_controller_every_cell_that_is_allowed_is_kept() -> None:
    """K = C. That an axis may go one way is needed for the law alone: the tests around show it."""
    (group,) = verified(text()).cases[0].groups
    assert ((group.core > 0) == group.allowed).all()


# ---------------------------------------------------------------- the formula


def phi(v: Floats) -> Floats:
    """The way to a stop with the weakest brake: the integral of max(v, SLOW) / B."""
    slow = np.minimum(v, SLOW)
    return np.asarray(slow * SLOW / B + (v * v - slow * slow) / (2 * B), np.float64)


def test_room_is_the_way_to_a_stop_and_a_stronger_brake_leaves_more() -> None:
    """Of x' = v, v' = -B (1 + more) s(v), stepped here, without the program's `room`."""
    rng = np.random.default_rng(4)
    v = rng.uniform(0.0, 10.0, 400)
    more = np.where(np.arange(400) < 200, 0.0, rng.uniform(0.0, MORE, 400))
    x, step = np.zeros(400), 1e-4
    expected, slack = phi(v), 1e-3
    for _ in range(int(8.0 / step)):
        middle = v - 0.5 * step * B * (1.0 + more) * np.clip(v / SLOW, 0.0, 1.0)
        x += step * middle
        v = v - step * B * (1.0 + more) * np.clip(middle / SLOW, 0.0, 1.0)
    assert v.max() < 1e-9
    assert np.abs(x - expected)[:200].max() < slack
    assert (x <= expected + slack).all()
    assert (expected - x)[200:].max() > 1.0


def test_the_plant_says_the_rate_of_that_room() -> None:
    """d(x_wall - x - phi)/dt, by differences, is what `der room` says, brake and throttle mixed."""
    flat = system_of(check_file("brake.soter", text()), None)
    problem = extract(flat, flat.modules[0])
    forms = CompiledEnclosures(library_of(problem)[0], problem, ())
    names = [q.name for q in problem.quantities.inputs]
    rng = np.random.default_rng(5)
    for _ in range(200):
        drive, brake = rng.uniform(0.0, 2.0), rng.choice([0.0, 1.0, rng.uniform()])
        v, more = rng.uniform(0.0, 10.0), rng.uniform(0.0, MORE)
        given = {"c.room": 30.0, "c.v": v, "command.drive": drive, "command.brake": brake}
        given |= {"c.more": more}
        box = np.array([[given.get(n, 0.0)] * 2 for n in names])
        rates = forms.result_bounds("derivative", box, 2)
        assert rates is not None
        s = min(max(v / SLOW, 0.0), 1.0)
        dv = (1.0 - brake) * drive - brake * B * (1.0 + more) * s
        expected = -v - max(v, SLOW) / B * dv
        assert rates[0].mean() == pytest.approx(expected, abs=1e-9)
        assert rates[1].mean() == pytest.approx(dv, abs=1e-9)


def test_runs_that_go_one_way_stay_in_what_the_engine_says() -> None:
    """Of the law, from random boxes: ends that are kept are kept by every run, and no other is."""
    rng = np.random.default_rng(6)
    for weaker in (0.0, 0.2):
        source = text(("float in [0.0, MORE]", f"float in [{-weaker}, MORE]"))
        flat = system_of(check_file("brake.soter", source), None)
        law = extract(flat, flat.modules[0]).law
        assert law is not None
        case = claims.open_case(law, library_of(law)[0], law.groups, ())
        engine: GridGroup = case.proofs[0].engine
        kept = fallen = 0
        for _ in range(40):
            low = np.array([rng.uniform(5.0, 40.0), rng.uniform(0.0, 8.0)])
            high = low + rng.uniform(0.01, 1.0, 2)
            images, tubes = engine.images_and_tubes(low, high, 4)
            assert len(images) == 4
            kept += int((images[:, 0, 0] >= low[0]).all())
            first = (law.times.delta_sc - law.times.jitter_sc) // STEP_NS
            runs = braked(rng, rng.uniform(low, high, (200, 2)), [first, *[100] * 3], weaker)
            for k, inside in enumerate(runs):
                for at in inside:
                    assert (at >= tubes[k, :, 0] - STEPPED).all()
                    assert (at <= tubes[k, :, 1] + STEPPED).all()
                assert (inside[-1] >= images[k, :, 0] - STEPPED).all()
                assert (inside[-1] <= images[k, :, 1] + STEPPED).all()
                fallen += int((inside[-1][:, 0] < low[0]).any())
        assert (kept == 40) == (weaker == 0.0)
        assert (fallen > 0) == (weaker > 0.0)


def braked(
    rng: np.random.Generator, at: Floats, holds: list[int], weaker: float
) -> list[list[Floats]]:
    """States (runs, 2) in each hold, of so many steps, fully braked; a midpoint rule."""
    states_by_hold, state, step = [], at.copy(), STEP_NS * 1e-9

    def rates(v: Floats, more: Floats) -> Floats:
        s = np.clip(v / SLOW, 0.0, 1.0)
        return np.stack([more * np.maximum(v, 0.0), -B * (1.0 + more) * s], 1)

    for steps in holds:
        inside = [state]
        more = rng.uniform(-weaker, MORE, len(at))
        more[: len(at) // 4] = -weaker
        for _ in range(steps):
            middle = state + 0.5 * step * rates(state[:, 1], more)
            state = state + step * rates(middle[:, 1], more)
            inside.append(state)
        states_by_hold.append(inside)
    return states_by_hold
