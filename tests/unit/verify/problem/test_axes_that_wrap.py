"""An axis that is a full turn wraps around exactly where nothing counts turns.

Sets on it against runs that know nothing of it, from headings many turns away; against the same
programs on axes of several turns; and programs in which somebody does count.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.turning_systems import Drawn
from soter.diagnostics.diagnostic import Source, Span
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file, system_of
from soter.verify.deploy.level_tables import Writer, place_function
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.enclose.enclosed_operations import FAR_TURNS, FARTHEST
from soter.verify.grid.grid_refinement import cells_around_box
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.extract import extract
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.problem.problem import Problem

TURN = 2 * math.pi
EXACT_TURN = 2 * Fraction(314159265358979323846264338327950288419716939937510, 10**50)


def problem_of(text: str) -> Problem:
    checked = check_file("boat.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


def sets_of(text: str) -> tuple[GridGroup, Problem, NDArray[np.bool_]]:
    """The engine, the problem, and K."""
    problem = problem_of(text)
    engine = GridGroup.for_group(library_of(problem)[0], problem, problem.groups[0])
    return engine, problem, engine.compute_core(engine.compute_constraint()).cells


def points_in(
    engine: GridGroup, cells: NDArray[np.bool_], chance: np.random.Generator
) -> NDArray[np.float64]:
    """States (n, runs) in cells of a set, at corners more often than not."""
    at = np.argwhere(cells)
    at = at[chance.integers(0, len(at), size=400)]
    share = chance.choice([1e-9, 1.0 - 1e-9, 0.5], size=at.shape)
    low = np.stack([e[at[:, k]] for k, e in enumerate(engine.edges)], axis=1)
    high = np.stack([e[at[:, k] + 1] for k, e in enumerate(engine.edges)], axis=1)
    return np.asarray((low + share * (high - low)).T)


@pytest.mark.parametrize("seed", range(6))
def test_from_k_sc_keeps_safe_however_many_turns_away(seed: int) -> None:
    drawn, chance = Drawn(seed), np.random.default_rng(seed)
    engine, problem, core = sets_of(drawn.text(32))
    assert problem.quantities.turning == {len(engine.axes) - 1}
    assert core.any()
    x = points_in(engine, core, chance)
    x[-1] += TURN * chance.integers(-2000, 2001, size=x.shape[1])
    delay = problem.times.delay_sc * 1e-9
    assert drawn.flown(x, chance, 80, delay).all()


@pytest.mark.parametrize("seed", range(3))
def test_what_an_axis_of_five_turns_keeps_around_its_middle_one_turn_keeps(seed: int) -> None:
    drawn = Drawn(seed)
    drawn.from_zero = False
    _, around, core = sets_of(drawn.text(32))
    _, along, wide = sets_of(drawn.text(32, turns=5))
    assert (bool(around.quantities.turning), bool(along.quantities.turning)) == (True, False)
    middle = wide[..., 64:96]
    assert middle.any()
    assert (core | ~middle).all()


@pytest.mark.parametrize("seed", range(2))
def test_no_command_leads_out_of_k_from_what_is_free(seed: int) -> None:
    drawn, chance = Drawn(seed), np.random.default_rng(seed)
    engine, _, core = sets_of(drawn.text(48))
    free = engine.cells_safe_for(200_000_000, core)
    assert free.any()
    x = points_in(engine, free, chance)
    u = chance.choice([-1.0, 1.0], size=x.shape[1])
    for _ in range(40):
        turned = chance.random(x.shape[1]) < 0.05
        u = np.where(turned, -u, u)
        w = drawn.numbers["push"] * chance.choice([-1.0, 1.0], size=x.shape[1])
        x = x + 0.005 * drawn.rate(x + 0.0025 * drawn.rate(x, u, w), u, w)
        h = (x[-1] - engine.edges[-1][0]) % TURN + engine.edges[-1][0]
        states = np.stack([*x[:-1], h])
        at = [
            np.searchsorted(e, v, side="right") - 1
            for e, v in zip(engine.edges, states, strict=True)
        ]
        inside = [np.clip(i, 0, n - 1) for i, n in zip(at, engine.shape, strict=True)]
        assert core[tuple(inside)].all()


MOVES = next(d for d in map(Drawn, range(20)) if d.moves and not d.from_zero and not d.by_sine)


@pytest.mark.parametrize(
    ("old", "new", "reader"),
    [
        ("publish turn = clamp({g}", "publish turn = clamp(0.01 * pose.h + {g}", "SC"),
        (
            "publish turn = clamp({g}",
            "let u = pose.h > 9.0 ? 0.1 : 0.0; publish turn = clamp(u + {g}",
            "SC",
        ),
        ("wrap_angle({a}", "wrap_angle(1.5 * pose.h + {a}", "SC"),
        ("der x = ", "der x = 0.001 * h + ", "the rate of `b.x`"),
        ("der x = ", "der x = abs(h) > 50.0 ? 0.1 : 0.0 + ", "the rate of `b.x`"),
        ("safe abs", "safe pose.h < 99.0 && abs", "`safe`"),
        ("h: float }", "h: float } in { h in [-9.0, 9.0] }", "what plants publish"),
        ("verify {", "verify { core pose.h < 9.0;", "`core`"),
        (
            "safe abs(pose.x) < 3.0;",
            "safe abs(pose.x) < 3.0; ttf pose.h > 2.0; safer abs(pose.x) < 1.0;",
            "`ttf`",
        ),
    ],
)
def test_an_axis_whose_turns_somebody_counts_does_not_wrap(old: str, new: str, reader: str) -> None:
    n = MOVES.numbers
    old, new = (
        t.replace("{g}", repr(n["gain"])).replace("{a}", repr(n["away"])) for t in (old, new)
    )
    text = MOVES.text(32)
    assert text.count(old) == 1, old
    problem = problem_of(text.replace(old, new))
    assert not problem.quantities.turning
    assert problem.turns_read["b.h"].startswith(reader)


@pytest.mark.parametrize(
    ("ends", "nearly"),
    [("-3.1415, 3.1415", True), ("-PI, 3.0", False), ("-2.0 * PI, 2.0 * PI", False)],
)
def test_an_axis_that_is_not_one_turn_does_not_wrap(ends: str, nearly: bool) -> None:
    """Of one that is nearly a turn it is kept that nobody reads how far it has turned."""
    text = MOVES.text(32).replace("[-PI, PI]", f"[{ends}]")
    problem = problem_of(text)
    assert not problem.quantities.turning
    assert problem.turns_read == ({"b.h": ""} if nearly else {})


def test_a_state_that_is_a_place_does_not_wrap_though_its_axis_is_as_long() -> None:
    text = MOVES.text(32).replace("pose.x in [-3.0, 3.0]", "pose.x in [-PI, PI]")
    assert problem_of(text).quantities.turning == {1}


def test_errors_reach_across_the_seam() -> None:
    problem = problem_of(MOVES.text(16))
    engine = GridGroup.for_group(library_of(problem)[0], problem, problem.groups[0])
    assert errors_by_state(problem)[1] >= MOVES.numbers["error"] + FAR_TURNS
    chance, width = np.random.default_rng(2), TURN / 16
    for off in (1e-6, 0.3 * width, 1.2 * width, 9.0 * width):
        cells = chance.random(engine.shape) < 0.8
        reach = int(off / width) + 1  # cells at either side that a cell and `off` touch
        around = range(-reach, reach + 1)
        near = [np.roll(cells, k, axis=1) for k in around]
        assert (engine.erode(cells, {1: off}) == np.logical_and.reduce(near)).all()
        assert (engine.dilate(cells, {1: off}) == np.logical_or.reduce(near)).all()


@pytest.mark.parametrize(("low", "high"), [(-math.pi, math.pi), (0.0, TURN), (-1.0, TURN - 1.0)])
def test_the_decision_module_finds_the_cell_of_an_estimate_any_number_of_turns_away(
    low: float, high: float
) -> None:
    chance = np.random.default_rng(1)
    edges = (*(low + (high - low) * k / 24 for k in range(24)), high)
    w = Writer(Span(Source("table.soter", "x"), 0, 1))
    place = Evaluator({}).closure_of(place_function(w, "place", edges, wraps=True))
    far = chance.uniform(-FARTHEST, FARTHEST, size=400)
    seams = np.array(
        [low + TURN * k + d for k in range(-2600, 2601, 400) for d in (-1e-12, 0, 1e-12)]
    )
    for x in [*far.tolist(), *seams.tolist(), *edges]:
        cell = place(Environment(), (x,))
        assert isinstance(cell, int)
        assert cell >= 0
        off = [
            Fraction(x) - Fraction(edges[cell + side]) - k * EXACT_TURN
            for side in (0, 1)
            for k in [round((x - edges[cell]) / TURN)]
        ]
        assert off[0] >= -Fraction(FAR_TURNS)
        assert off[1] <= Fraction(FAR_TURNS)
    for x in (FARTHEST * 1.01, -1e9, math.inf, math.nan):
        assert place(Environment(), (x,)) == -1


@pytest.mark.parametrize("seed", range(4))
def test_a_start_is_in_the_cells_of_its_heading_however_many_turns_away(seed: int) -> None:
    """Across the seam as well: no state of its range is in another cell."""
    drawn, chance = Drawn(seed), np.random.default_rng(seed)
    text = drawn.text(32)
    (declared,) = re.findall(r"state h: float = [^;]*;", text)
    for _ in range(4):
        low, width = chance.uniform(-900.0, 900.0), float(chance.choice([0.0, 0.2, 3.0, 6.5]))
        ends = f"in [{float(low)!r}, {float(low) + width!r}]" if width else f"= {float(low)!r}"
        problem = problem_of(text.replace(declared, f"state h: float {ends};"))
        axis = next(a for a in problem.groups[0].axes if a.wraps)
        edges, start = np.array(axis.edges), problem.initial[axis.state]
        (cells,) = cells_around_box([edges], [True], [start])
        assert cells is not None
        for x in chance.uniform(low, low + width, size=40) if width else [low]:
            near = edges[0] + (Fraction(float(x)) - Fraction(edges[0])) % EXACT_TURN
            at = int(np.searchsorted(edges, float(near), side="right")) - 1
            assert min(at, len(edges) - 2) in cells
