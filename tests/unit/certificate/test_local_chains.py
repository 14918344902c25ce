"""Chains, of flows that are not linear above all: what is computed encloses simulated runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from flint import arb

from soter.certificate.cell_sets import Grid
from soter.certificate.grid.flow_chains import FlowChain, Times
from soter.certificate.grid.flow_enclosures import Enclosure, LocalFlow, SolvedFlow
from soter.certificate.grid.group_claims import ChainCheck, FreeCheck, GroupTables
from soter.certificate.grid.sc_chains import EVERY, NANOSECOND, uncrossed_ends, windows_of_runs
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.linear_flows import has_linear_rates, linear_flow
from soter.certificate.terms.compile_terms import form_of_box
from soter.certificate.terms.linear_enclosures import ONE, ZERO, exact
from soter.certificate.terms.straight_line import NotCertainError, product
from tables import all_rows
from unit.certificate import small_proofs
from unit.verify.time.late_sc_runs import LateRuns

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    Floats = np.ndarray[Any, np.dtype[np.float64]]
    Rates = Callable[[Floats, Floats, Floats, Floats], tuple[Any, Any]]

TEXT = """soter 1;
type Pair = {{ x: float, v: float }};
topic seen: Pair max_age {age}ms;
topic push: float in [-{force}, {force}] = 0.0;
plant Thing period 1ms {{
  reads push;
  drives seen = {{ x: x, v: v }};
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance w: float in [-{wind}, {wind}];
  der x = {der_x};
  der v = {der_v};
  measured seen.x within 0.01, seen.v within 0.02;
}}
node Any period {delta}ms {{ subscribes seen; publishes push; step {{ publish push = 0.0; }} }}
node Back period {delta}ms {{
  subscribes seen;
  publishes push;
  step {{ publish push = clamp(-2.0 * seen.x - 1.5 * seen.v, -{force}, {force}); }}
}}
rta Module {{
  ac Any;
  sc Back;
  period 20ms;
  safe abs(seen.x) < 2.0;
  ttf abs(seen.x) > 1.0;
  safer abs(seen.x) < 0.5;
  verify {{ grid t.x in [-2.0, 2.0] / 40, t.v in [-2.0, 2.0] / 40; late sc {late}ms, dm 1ms; }}
}}
system S default {{ t: Thing; module Module; until 10s; }}
"""


@dataclass(frozen=True)
class Thing:
    """A plant with two states, as a text and in NumPy."""

    der_x: str
    der_v: str
    rates: Rates
    force: float = 1.0
    wind: float = 0.2


THINGS = {
    "drag": Thing(
        "v",
        "push - 0.4 * v * abs(v) + w",
        lambda _, v, u, w: (v, u - 0.4 * v * np.abs(v) + w),
    ),
    "pendulum": Thing(
        "v",
        "3.0 * sin(x) - 0.2 * v + push + w",
        lambda x, v, u, w: (v, 3.0 * np.sin(x) - 0.2 * v + u + w),
        force=4.0,
    ),
    "lane": Thing(
        "2.0 * sin(v)", "push + w * cos(v)", lambda _, v, u, w: (2 * np.sin(v), u + w * np.cos(v))
    ),
    "product": Thing(
        "v + 0.1 * x * v",
        "push * (1.0 + 0.3 * x) - v + w",
        lambda x, v, u, w: (v + 0.1 * x * v, u * (1 + 0.3 * x) - v + w),
    ),
    "linear": Thing(
        "v", "2.0 * push - 0.5 * v + w", lambda _, v, u, w: (v, 2.0 * u - 0.5 * v + w), wind=0.1
    ),
    "limited": Thing(
        "clamp(v, -1.0, 1.0)",
        "push - sqrt(1.0 + v * v) + 1.0 + w",
        lambda _, v, u, w: (np.clip(v, -1, 1), u - np.sqrt(1 + v * v) + 1 + w),
    ),
}
TIMES = ((5, 20, 0), (15, 20, 3), (50, 20, 2), (75, 20, 4))
"""Age, delta, lateness of SC in ms: up to four commands may have acted since a read."""


def model_of(
    tmp_path: Path, thing: Thing, age: int, delta: int, late: int, *, two: bool = False
) -> CaseModel:
    path = tmp_path / "thing.soter"
    text = TEXT
    for one, other in TWO if two else ():
        assert one in text
        text = text.replace(one, other)
    path.write_text(
        text.format(
            age=age,
            delta=delta,
            late=late,
            force=thing.force,
            wind=thing.wind,
            der_x=thing.der_x,
            der_v=thing.der_v,
        )
    )
    facts = small_proofs.facts_of(path, "S", "Module")
    facts.times["d_ns"] = age * 10**6  # as of a sensor that may be so late
    return CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))


TWO = (
    ("topic push: float in [-{force}, {force}] = 0.0;", "topic push: Two in [-0.5, 0.5];"),
    ("type Pair", "type Two = {{ a: float, b: float }};\ntype Pair"),
    ("push = 0.0;", "push = {{ a: 0.0, b: 0.0 }};"),
    (
        "push = clamp(-2.0 * seen.x - 1.5 * seen.v, -{force}, {force});",
        "push = {{ a: clamp(-2.0 * seen.x, -0.5, 0.5), b: clamp(-1.5 * seen.v, -0.5, 0.5) }};",
    ),
)
"""Two commands, whose sum is what is felt."""


def delays(model: CaseModel) -> tuple[int, int]:
    """How old the sample behind a command is, how late a command may act, in ns."""
    return model.facts.delay_ns, model.facts.jitter_ns


def local_chain(
    model: CaseModel, kept: Sequence[tuple[bool, bool]] = ((False, False),) * 2
) -> FlowChain:
    """The chain of the two states, over balls."""
    delta, d, j = (t * NANOSECOND for t in (model.facts.times["delta_ns"], *delays(model)))
    times = Times(delta, d, j, j, (-d, Fraction(0)))
    flow: LocalFlow | SolvedFlow = LocalFlow(model, (0, 1), kept)
    if has_linear_rates(model, (0, 1)):
        flow = SolvedFlow(model, (0, 1), linear_flow(model, (0, 1)), kept)
    return FlowChain(model, (0, 1), flow, times)


def group_of(model: CaseModel) -> GroupTables:
    grid = Grid(tuple(small_proofs.even_edges(*e, 40) for e in model.extents))
    return GroupTables((0, 1), grid, np.ones(grid.shape, dtype=np.uint8))


class Runs:
    """Many SC-runs at once from one cell, every bound played against at random; a tick is 1 ms."""

    def __init__(self, thing: Thing, model: CaseModel, box: Sequence[float], seed: int) -> None:
        self.thing, self.draw = thing, np.random.default_rng(seed)
        self.count = 60
        self.delta = model.facts.times["delta_ns"] // 10**6
        self.d, self.j = (t // 10**6 for t in delays(model))
        corner = self.draw.integers(3, size=(2, self.count))
        part = np.where(corner == 2, self.draw.random((2, self.count)), corner)
        self.x = box[0] + (box[1] - box[0]) * part[0]
        self.v = box[2] + (box[3] - box[2]) * part[1]

    def extreme(self, size: float) -> Floats:
        kind = self.draw.integers(5, size=self.count)
        return np.choose(
            kind, [-size, size, -size, size, self.draw.uniform(-size, size, self.count)]
        )

    def step(self, x: Floats, v: Floats, u: Floats, w: Floats, h: float) -> tuple[Floats, Floats]:
        f = self.thing.rates
        a = f(x, v, u, w)
        b = f(x + h / 2 * a[0], v + h / 2 * a[1], u, w)
        c = f(x + h / 2 * b[0], v + h / 2 * b[1], u, w)
        e = f(x + h * c[0], v + h * c[1], u, w)
        return (
            x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + e[0]),
            v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + e[1]),
        )

    def law(self, x: Floats, v: Floats) -> Floats:
        y_x, y_v = x + self.extreme(0.01), v + self.extreme(0.02)
        return np.clip(-2.0 * y_x - 1.5 * y_v, -self.thing.force, self.thing.force)

    def laws(self, x: Floats, v: Floats) -> Floats:
        """Of two commands the sum."""
        y_x, y_v = x + self.extreme(0.01), v + self.extreme(0.02)
        return np.clip(-2.0 * y_x, -0.5, 0.5) + np.clip(-1.5 * y_v, -0.5, 0.5)

    def chain(
        self, holds: int, p: tuple[int, int] | None = None, ages: tuple[int, int] | None = None
    ) -> tuple[list[Any], Any]:
        """States (2, count) at every tick from a_0 on, and the ticks a_holds.

        `p`: between which ticks a_0 was after the beginning of its window, the same for all of a
        run. `ages`: how many ticks before a_0 the first sample was taken, at least and at most.
        """
        force, wind = self.thing.force, self.thing.wind
        past = [(self.x, self.v)]
        u, w = self.extreme(force), self.extreme(wind)
        for _ in range(self.d):
            if self.draw.random() < 0.1:
                u, w = self.extreme(force), self.extreme(wind)
            past.append(self.step(*past[-1], u, w, -1e-3))
        states = past[::-1]
        acts = np.arange(holds + 1)[:, None] * self.delta
        if p is None:
            acts = acts + self.draw.choice([-self.j, 0, self.j], (holds + 1, self.count))
        else:
            late = self.draw.choice([0, self.j, self.j // 2], (holds + 1, self.count))
            acts = acts - self.draw.choice(p, self.count) + late
        acts[0] = 0
        command = np.zeros(self.count)
        every = np.arange(self.count)
        for tick in range(holds * self.delta + self.j + 1):
            for k in range(holds):
                due = acts[k] == tick
                if due.any():
                    age = self.draw.choice([0, self.d, self.d // 2], self.count)
                    if k == 0 and ages is not None:
                        age = self.draw.choice(ages, self.count)
                    x = np.array([s[0] for s in states])[tick + self.d - age, every]
                    v = np.array([s[1] for s in states])[tick + self.d - age, every]
                    command = np.where(due, self.law(x, v), command)
            if tick % 5 == 0:
                w = np.where(self.draw.random(self.count) < 0.3, self.extreme(wind), w)
            states.append(self.step(*states[-1], command, w, 1e-3))
        return states[self.d :], acts

    def free(self, ticks: int) -> list[tuple[Floats, Floats]]:
        states = [(self.x, self.v)]
        u, w = self.extreme(self.thing.force), self.extreme(self.thing.wind)
        for _ in range(ticks):
            swap = self.draw.random(self.count) < 0.05
            u = np.where(swap, self.extreme(self.thing.force), u)
            w = np.where(swap, self.extreme(self.thing.wind), w)
            states.append(self.step(*states[-1], u, w, 1e-3))
        return states


def sure(value: Any) -> Any:
    """What must not be None."""
    assert value is not None
    return value


def inside(boxes: Sequence[float], state: Any) -> np.ndarray[Any, Any]:
    """Of each state whether one of the boxes holds it, but for what the simulation rounds."""
    mask = np.zeros(len(state[0]), dtype=bool)
    slack = 1e-9
    for k in range(0, len(boxes), 4):
        a, b, c, e = boxes[k : k + 4]
        mask |= (
            (state[0] >= a - slack)
            & (state[0] <= b + slack)
            & ((state[1] >= c - slack) & (state[1] <= e + slack))
        )
    return mask


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("name", sorted(THINGS))
@pytest.mark.parametrize("pieces", [1, 4])
def test_chains_enclose_runs(
    tmp_path: Path, name: str, times: tuple[int, int, int], pieces: int
) -> None:
    thing = THINGS[name]
    model = model_of(tmp_path, thing, *times)
    assert has_linear_rates(model, (0, 1)) == (name == "linear")
    group = group_of(model)
    chain = ChainCheck(model, group).compiled_chain(pieces)
    holds, shares = 6, []
    for seed in range(4):
        cell = tuple(int(i) for i in np.random.default_rng(seed).integers(6, 34, 2))
        block = tuple((i, i + 1) for i in cell)
        ends = [float(x) for interval in group.grid.box_of(block) for x in interval]
        runs = Runs(thing, model, ends, seed)
        states, acts = runs.chain(holds)
        form = form_of_box(group.grid.box_of(block), symbols=True)
        before = 0
        for k in range(holds):
            form_and_boxes = (chain.later if k else chain.first)(form)
            assert form_and_boxes is not None
            form, boxes = form_and_boxes
            after = (k + 1) * runs.delta - runs.j
            for tick in range(before, after + 1):
                assert inside(boxes, states[tick]).all(), (k, tick)
            image = [float(x) for x in form[:4]]
            assert inside(image, states[after]).all()
            before = after
            if k + 1 < holds:
                continue
            for axis in (0, 1):
                spread = states[after][axis].max() - states[after][axis].min()
                shares.append(spread / (image[2 * axis + 1] - image[2 * axis]))
        last = image if chain.last is None else sure(sure(chain.last)(form))[1]
        for run, tick in enumerate(acts[holds]):
            state = tuple(s[run : run + 1] for s in states[tick])
            assert inside(last, state).all()
    assert min(shares) > 0.15, "what encloses everything says nothing"


@all_rows("forgotten_ms", [0, 60])
@all_rows("name", sorted(THINGS))
def test_chains_of_late_commands_enclose_runs(tmp_path: Path, name: str, forgotten_ms: int) -> None:
    """Commands act up to 100 ms late, every 20 ms; runs leave chains of reads that are younger."""
    thing = THINGS[name]
    model_of(tmp_path, thing, 5, 20, 3)  # writes the program
    path = tmp_path / "thing.soter"
    path.write_text(path.read_text().replace("dm 1ms;", "dm 1ms; acts within 100ms;"))
    facts = small_proofs.facts_of(path, "S", "Module")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    assert facts.has_late_commands
    age = facts.derived.age_sc // 10**6
    runs = LateRuns(
        lambda x, u, w: np.stack(np.broadcast_arrays(*thing.rates(x[0], x[1], u, w))),
        lambda y: np.clip(-2.0 * y[0] - 1.5 * y[1], -thing.force, thing.force),
        (-thing.force, thing.force), (-thing.wind, thing.wind), period=20, errors=0.01,
        waits=3, acts=100, age=age,
    )  # fmt: skip
    assert facts.derived.in_force <= runs.read_age * 10**6 <= facts.derived.in_force + 4 * 10**6
    facts.derived = replace(facts.derived, in_force=facts.derived.in_force - forgotten_ms * 10**6)
    chain, escaped = ChainCheck(model, group_of(model)).compiled_chain(2), 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        low = rng.uniform(-0.9, 0.8, 2)
        high = low + 0.05
        box = [(exact(float(a)), exact(float(b))) for a, b in zip(low, high, strict=True)]
        form, met = form_of_box([(a.union(a), b.union(b)) for a, b in box], symbols=True), []
        for k in range(5):
            found = (chain.later if k else chain.first)(form)
            assert found is not None
            form = found[0]
            met.append((found[1], [float(x) for x in form[:4]]))
        start = np.stack([rng.choice([a, b], 200) for a, b in zip(low, high, strict=True)])
        for tick, x in runs.states(start, 5, rng):
            k, rest = divmod(tick, runs.period)
            escaped += (~inside(met[min(k, 4)][0], x)).sum()
            escaped += (~inside(met[k - 1][1], x)).sum() if k and not rest else 0
    assert (escaped == 0) == (forgotten_ms == 0)


@pytest.mark.parametrize("times", [(5, 20, 8), (15, 20, 4), (50, 20, 4)])
@pytest.mark.parametrize("name", ["drag", "linear"])
def test_chains_of_a_window_enclose_its_runs(
    tmp_path: Path, name: str, times: tuple[int, int, int]
) -> None:
    """All of a run is as late as its first command was, give or take: less than any lateness."""
    thing, count = THINGS[name], 4
    model = model_of(tmp_path, thing, *times)
    group = group_of(model)
    check = ChainCheck(model, group)
    windows = windows_of_runs(model, group.states, check.delay_ns)
    assert len(windows) == count
    sizes = []
    for window in windows:
        chain, whole = check.compiled_chain(1, window), check.compiled_chain(1, EVERY)
        early = window.early_and_late(Fraction(model.facts.jitter_ns))[0] / 10**6
        cell = (14 + 3 * window.index, 24 - 3 * window.index)
        block = tuple((i, i + 1) for i in cell)
        ends = [float(x) for interval in group.grid.box_of(block) for x in interval]
        runs = Runs(thing, model, ends, window.index)
        assert runs.j % count == 0
        p = (runs.j * window.index // count, runs.j * (window.index + 1) // count)
        states, acts = runs.chain(5, p)
        form = any_run = form_of_box(group.grid.box_of(block), symbols=True)
        for k in range(5):
            form, boxes = sure((chain.later if k else chain.first)(form))
            any_run = sure((whole.later if k else whole.first)(any_run))[0]
            after = int((k + 1) * runs.delta - early)
            assert inside([float(x) for x in form[:4]], states[after]).all()
            for tick in range(max(after - 5, 0), after + 1):
                assert inside(boxes, states[tick]).all(), (k, tick)
        last, others = sure(sure(chain.last)(form))[1], sure(sure(whole.last)(any_run))[1]
        for run, tick in enumerate(acts[5]):
            assert inside(last, tuple(s[run : run + 1] for s in states[tick])).all()
        sizes.append([max(b[1::2]) - min(b[0::2]) for b in (last, others)])
    assert all(own < whole for own, whole in sizes)


@pytest.mark.parametrize("times", [(8, 20, 4), (52, 20, 4)])
def test_chains_of_first_samples_of_an_age_enclose_their_runs(
    tmp_path: Path, times: tuple[int, int, int]
) -> None:
    """Parts by how old the first sample was: all of them are all runs, none is wider than all."""
    count = 4
    model = model_of(tmp_path, THINGS["linear"], *times)
    group = group_of(model)
    check = ChainCheck(model, group)
    parts = windows_of_runs(model, group.states, check.delay_ns, by_age=True)
    assert not any(t // 10**6 % count for t in delays(model))
    delay, jitter = (Fraction(t, 10**6) for t in delays(model))
    ends = sorted({w.sample_span(delay) for w in parts})
    assert [ends[0][0], ends[-1][1]] == [-delay, 0]
    assert all(a[1] == b[0] for a, b in pairwise(ends))
    assert {(w.index, w.age) for w in parts} == {(k, a) for k in range(count) for a in range(count)}
    sizes = []
    block = tuple((i, i + 1) for i in (24, 18))
    box = [float(x) for interval in group.grid.box_of(block) for x in interval]
    for seed, window in enumerate(parts):
        runs = Runs(THINGS["linear"], model, box, seed)
        ages = tuple(int(-t) for t in window.sample_span(delay))
        p = (int(jitter) * window.index // count, int(jitter) * (window.index + 1) // count)
        states, acts = runs.chain(3, p, (ages[1], ages[0]))
        images = []
        for one in (window, EVERY):
            chain = check.compiled_chain(1, one)
            form = form_of_box(group.grid.box_of(block), symbols=True)
            for k in range(3):
                form = sure((chain.later if k else chain.first)(form))[0]
            images.append(sure(chain.last(form))[1] if chain.last else [float(x) for x in form[:4]])
        for run, tick in enumerate(acts[3]):
            assert inside(images[0], tuple(s[run : run + 1] for s in states[tick])).all()
        sizes.append([max(b[1::2]) - min(b[0::2]) for b in images])
    assert all(own <= whole for own, whole in sizes)
    assert any(own < whole for own, whole in sizes)


def test_what_comes_several_ways_is_not_told_apart_by_age(tmp_path: Path) -> None:
    """One topic may then show an older instant than another: no age is that of both."""
    model = model_of(tmp_path, THINGS["linear"], 15, 20, 0)
    (read,) = model.facts.setting.by_sc
    model.facts.setting = replace(model.facts.setting, by_sc=(read, read))
    asked = model, (0, 1), model.facts.delay_ns
    assert windows_of_runs(*asked, by_age=True) == windows_of_runs(*asked)


@pytest.mark.parametrize("times", TIMES)
def test_two_commands_that_the_group_feels(tmp_path: Path, times: tuple[int, int, int]) -> None:
    thing = Thing(
        "v",
        "(push.a + push.b) * (1.0 + 0.3 * x) - 0.4 * v * abs(v) + w",
        lambda x, v, u, w: (v, u * (1 + 0.3 * x) - 0.4 * v * np.abs(v) + w),
    )
    model = model_of(tmp_path, thing, *times, two=True)
    group = group_of(model)
    chain = ChainCheck(model, group).compiled_chain(1)
    for seed in range(4):
        cell = tuple(int(i) for i in np.random.default_rng(seed).integers(6, 34, 2))
        block = tuple((i, i + 1) for i in cell)
        ends = [float(x) for interval in group.grid.box_of(block) for x in interval]
        runs = Runs(thing, model, ends, seed)
        runs.law = runs.laws  # type: ignore[method-assign]
        states, acts = runs.chain(5)
        form = form_of_box(group.grid.box_of(block), symbols=True)
        for k in range(5):
            form, boxes = sure((chain.later if k else chain.first)(form))
            after = (k + 1) * runs.delta - runs.j
            assert inside([float(x) for x in form[:4]], states[after]).all()
            for tick in range(max(after - 3, 0), after + 1):
                assert inside(boxes, states[tick]).all()
        last = [float(x) for x in form[:4]]
        if chain.last is not None:
            last = sure(chain.last(form))[1]
        for run, tick in enumerate(acts[5]):
            assert inside(last, tuple(s[run : run + 1] for s in states[tick])).all()
        for axis in (0, 1):
            spread = states[after][axis].max() - states[after][axis].min()
            assert spread > 0.15 * float(form[2 * axis + 1] - form[2 * axis])


@all_rows("name", sorted(THINGS))
@all_rows("pieces", [2, 8])
def test_free_phases_enclose_runs(tmp_path: Path, name: str, pieces: int) -> None:
    thing = THINGS[name]
    model = model_of(tmp_path, thing, 15, 20, 3)
    group = group_of(model)
    phase = FreeCheck(model, group, 80 * 10**6).compiled_steps(pieces)
    for seed in range(6):
        cell = tuple(int(i) for i in np.random.default_rng(seed).integers(6, 34, 2))
        block = tuple((i, i + 1) for i in cell)
        ends = [float(x) for interval in group.grid.box_of(block) for x in interval]
        form = form_of_box(group.grid.box_of(block), symbols=True)
        (step,) = phase
        image = step(form)
        assert image is not None
        for state in Runs(thing, model, ends, seed).free(80):
            assert inside(image[1], state).all()


def test_steps_solve_the_linear_model() -> None:
    """The solution formula against small steps, with a disturbance that is always against us."""
    draw = np.random.default_rng(3)
    for _ in range(20):
        a, noise = draw.uniform(-4, 4, (2, 2)), draw.uniform(0, 1, 2)
        time = float(draw.uniform(0.01, 0.3))
        flow = object.__new__(LocalFlow)  # the formulas alone
        flow.n, flow.moves = 2, [0]
        rows = [[exact(float(x)) for x in row] for row in a]
        sizes = [exact(float(x)) for x in noise]
        local = Enclosure([], rows, [[ONE], [ZERO]], [ZERO, ONE], sizes, [], [])
        span = Fraction(time)
        law, off = flow.solution_over(local, span), flow.noise_bounds(local, Fraction(0), span, [])
        e, total, steps = np.eye(2), np.zeros((2, 2)), 4000
        worst = np.zeros(2)
        h = time / steps
        for _ in range(steps):
            worst += np.abs(e) @ noise * h
            total += e * h
            e = e + h * (a @ e) + h * h / 2 * (a @ a @ e)
        for i in range(2):
            assert abs(float(law.control[i][0]) - total[i, 0]) < 1e-3
            assert abs(float(law.constant[i]) - total[i, 1]) < 1e-3
            assert worst[i] * (1 - 1e-3) < float(off[i]) < worst[i] * 2.5 + 1e-9
            for j in range(2):
                assert abs(float(law.state[i][j]) - e[i, j]) < 1e-4


# ---------------------------------------------------------------- ends


@all_rows(
    ("der_x", "low", "high"),
    [
        ("push + 1.0 - sqrt(max(x + 2.0, 0.0))", True, True),  # 2 - 2 at the upper end
        ("push + 1.001 - sqrt(max(x + 2.0, 0.0))", True, False),
        ("push + 0.999 - sqrt(max(x + 2.0, 0.0))", False, True),
        ("push + w - x * abs(x)", True, True),
        ("push + 4.0 * w - x * abs(x)", True, True),
        ("4.0 * push + w - x * abs(x)", False, False),
        ("v * abs(v) * (2.0 - x) * (2.0 + x)", True, True),  # along the ends
        ("v * abs(v) * (2.0 - x) * (2.001 + x)", False, True),
        ("v - 1.1 * x * abs(x)", True, True),
        ("v - 0.49 * x * abs(x)", False, False),
        ("min(push, 0.0) - x - 2.0", False, True),
        ("2.0 * push - x", True, True),
        ("1.9 * push - x", True, True),
        ("2.1 * push - x", False, False),
    ],
)
def test_ends_that_the_flow_keeps(tmp_path: Path, der_x: str, low: bool, high: bool) -> None:
    thing = Thing(der_x, "push + w", lambda x, v, _u, _w: (x, v))
    model = model_of(tmp_path, thing, 5, 20, 0)
    assert uncrossed_ends(model, (0, 1))[0] == (low, high)


@pytest.mark.parametrize("kept", [True, False])
def test_boxes_end_where_the_flow_keeps_the_end(tmp_path: Path, kept: bool) -> None:
    """From the cell at the end nothing comes out beyond it, whatever is commanded."""
    thing = Thing("max(push, 0.0) - 2.0 * (x + 2.0) * abs(v)", "-v * abs(v)", lambda *_: (0, 0))
    model = model_of(tmp_path, thing, 5, 20, 1)
    assert uncrossed_ends(model, (0, 1))[0] == (True, False)
    local = local_chain(model, [(kept, kept), (False, False)])
    group = group_of(model)
    box = group.grid.box_of(((0, 1), (36, 37)))
    lowest = [
        sure(local.boxes_under_any_commands(Fraction(1, 20), 2, form_of_box(box, symbols=True)))[1]
    ]
    form = form_of_box(box, symbols=True)
    for k in range(3):
        form, boxes = sure(
            (local.lead_over_later_hold if k else local.lead_over_first_hold)(1, form)
        )
        lowest.append(boxes)
        assert float(form[0]) >= -2.0 or not kept
    lowest.append(sure(local.last_switch_boxes(1, form))[1])
    assert (min(min(boxes[0::4]) for boxes in lowest) >= -2.0) == kept


def test_ends_of_linear_flows_are_cut_off(tmp_path: Path) -> None:
    thing = Thing("1.9 * push - x", "push + w", lambda *_: (0, 0))
    model = model_of(tmp_path, thing, 5, 20, 1)
    assert has_linear_rates(model, (0, 1))
    group = group_of(model)
    chain = ChainCheck(model, group).compiled_chain(1)
    form = form_of_box(group.grid.box_of(((0, 1), (20, 21))), symbols=True)
    for k in range(3):
        form, boxes = sure((chain.later if k else chain.first)(form))
        assert min(boxes[0::4]) >= -2.0
    (step,) = FreeCheck(model, group, 50 * 10**6).compiled_steps(4)
    image = sure(step(form_of_box(group.grid.box_of(((0, 1), (20, 21))), symbols=True)))
    assert min(image[1][0::4]) == -2.0


def test_what_stands_is_where_it_was(tmp_path: Path) -> None:
    """Rates that are exactly zero leave exactly the cell; the others do not."""
    thing = Thing("x * max(push - 1.0, 0.0) + max(v - 2.0, 0.0)", "0.0 * sin(x)", lambda *_: (0, 0))
    model = model_of(tmp_path, thing, 15, 20, 3)
    group = group_of(model)
    cell = ((7, 8), (11, 12))
    ends = [float(x) for interval in group.grid.box_of(cell) for x in interval]
    chain = ChainCheck(model, group).compiled_chain(1)
    form = form_of_box(group.grid.box_of(cell), symbols=True)
    for k in range(4):
        image = (chain.later if k else chain.first)(form)
        assert image is not None
        form, boxes = image
        assert list(boxes) == ends * (len(boxes) // 4)
    assert list(sure(sure(chain.last)(form))[1]) == ends
    assert arb(form[0]) == ends[0]


def crafted(depth: int, state: Floats, old: Floats) -> tuple[arb, ...]:
    """A small cell, its symbols, and commands before that are independent of it."""
    middle = [*state, *old]
    half = [0.01, 0.01] + [0.05] * depth
    form = [exact(float(m + s * h)) for m, h in zip(middle, half, strict=True) for s in (-1, 1)]
    form += [exact(float(m)) for m in middle]
    form += [exact(0.01 if i == k else 0.0) for i in range(len(middle)) for k in range(2)]
    form += [ZERO, ZERO] + [exact(0.05)] * depth + [ZERO] * (2 * depth)
    return tuple(form)


@all_rows("pieces", [1, 3])
@all_rows("times", [(15, 20, 3), (50, 20, 2), (75, 20, 4)])
@all_rows("name", ["drag", "product", "linear"])
def test_a_hold_after_commands_that_differ_much(  # noqa: PLR0915  one run, looked at thrice
    tmp_path: Path, name: str, times: tuple[int, int, int], pieces: int
) -> None:
    """Each acted for as long as it may have: samples, states after, what a form remembers."""
    thing = THINGS[name]
    model = model_of(tmp_path, thing, *times)
    delta, d, j = (t // 10**6 for t in (model.facts.times["delta_ns"], *delays(model)))
    local = local_chain(model)
    draw = np.random.default_rng(5)
    reached = {"sample": 0.0, "state": 0.0, "command": 0.0}
    for seed in range(8):
        state, old = draw.uniform(-0.4, 0.4, 2), draw.choice([-0.9, 0.9], local.depth)
        if seed < 2:  # the latest command against all others
            old = np.array([0.9, *[-0.9] * (local.depth - 1)]) * (1 - 2 * seed)
        form = crafted(local.depth, state, old)
        start = local.layout.take_apart(form, None)
        sample = local._sampled_states(start, fresh=False)
        centre = product(sample.rows, start.z)
        image = local.lead_over_later_hold(pieces, form)
        after = [float(x) for x in image[0]]
        runs = Runs(thing, model, [0.0] * 4, seed)
        eps = np.array([runs.extreme(1.0) for _ in range(2)])
        runs.x, runs.v = (state[i] + 0.01 * eps[i] for i in range(2))
        commands = [u + runs.extreme(0.05) for u in old]
        w, switch = runs.extreme(thing.wind), runs.draw.choice([0, 2 * j], runs.count)
        past, late = [(runs.x, runs.v)], runs.draw.choice([0, 2 * j])
        for tick in range(d):  # the k-th command before acted from -k delta (+ 2j) on
            k = min((tick + late) // delta, local.depth - 1)
            past.append(runs.step(*past[-1], commands[k], w, -1e-3))
        past, command = past[::-1], commands[0]
        ages = runs.draw.choice([0, d, d // 2], runs.count)
        for tick in range(delta):
            due = switch == tick
            at = [
                np.array([s[i] for s in past])[d + tick - ages, range(runs.count)] for i in (0, 1)
            ]
            for i in range(2):  # reads that never act are reads within the window, too
                if tick > 2 * j:
                    continue
                low, high = (float(end) for end in sample.box[i])
                assert ((at[i] >= low - 1e-9) & (at[i] <= high + 1e-9))[switch >= tick].all()
                most = float(sample.rest[i])
                most += sum(abs(float(x)) for x in centre[i][1:])
                off = (np.abs(at[i] - float(centre[i][0])) / most)[switch >= tick]
                assert (off <= 1 + 1e-9).all()
                reached["sample"] = max(reached["sample"], float(off.max(initial=0.0)))
            command = np.where(due, runs.law(*at), command)
            past.append(runs.step(*past[-1], command, w, 1e-3))
        n, count = 2, 2 + local.depth
        m, g = np.array(after[2 * count : 3 * count]), np.array(after[3 * count : 5 * count])
        rest, common = np.array(after[5 * count : 6 * count]), np.array(after[6 * count :])
        values = m[:, None] + g.reshape(count, n) @ eps
        off = np.array(past[-1]) - values[:n]
        share = np.abs(off) / rest[:n, None]
        assert (share <= 1 + 1e-9).all()
        reached["state"] = max(reached["state"], float(share.max()))
        remembered = [command, *commands][: local.depth]
        for k, u in enumerate(remembered):
            left = u - values[n + k] - common.reshape(-1, n)[k] @ off
            share = np.abs(left) / max(rest[n + k], 1e-9)
            assert (share <= 1 + 1e-3).all()
            reached["command"] = max(reached["command"], float(share.max()))
    assert min(reached.values()) > 0.5, reached


@pytest.mark.parametrize("times", [(15, 20, 3), (50, 20, 2), (75, 20, 4)])
def test_a_linear_hold_after_commands_that_differ_much(
    tmp_path: Path, times: tuple[int, int, int]
) -> None:
    """The same of a chain that is compiled: the state after, point by point."""
    thing = THINGS["linear"]
    model = model_of(tmp_path, thing, *times)
    delta, d, j = (t // 10**6 for t in (model.facts.times["delta_ns"], *delays(model)))
    depth = -(-(d + 2 * j) // delta)
    chain = ChainCheck(model, group_of(model)).compiled_chain(1)
    draw, reached = np.random.default_rng(5), 0.0
    for seed in range(16):
        state, old = draw.uniform(-0.2, 0.2, 2), draw.choice([-0.9, 0.9], depth)
        after = [float(x) for x in sure(chain.later(crafted(depth, state, old)))[0]]
        runs = Runs(thing, model, [0.0] * 4, seed)
        eps = np.array([runs.extreme(1.0) for _ in range(2)])
        commands = [u + runs.extreme(0.05) for u in old]
        w, switch = runs.extreme(thing.wind), runs.draw.choice([0, 2 * j], runs.count)
        past = [(state[0] + 0.01 * eps[0], state[1] + 0.01 * eps[1])]
        for tick in range(d):
            past.append(runs.step(*past[-1], commands[min(tick // delta, depth - 1)], w, -1e-3))
        past, command = past[::-1], commands[0]
        ages = runs.draw.choice([0, d], runs.count)
        for tick in range(delta):
            at = [
                np.array([s[i] for s in past])[d + tick - ages, range(runs.count)] for i in (0, 1)
            ]
            command = np.where(switch == tick, runs.law(*at), command)
            past.append(runs.step(*past[-1], command, w, 1e-3))
        count = 2 + depth
        m, g = np.array(after[2 * count :])[:2], np.array(after[3 * count :])[:4]
        rest = np.array(after[5 * count :])[:2]
        off = np.abs(np.array(past[-1]) - m[:, None] - g.reshape(2, 2) @ eps) / rest[:, None]
        assert (off <= 1 + 1e-9).all()
        reached = max(reached, float(off.max()))
    assert reached > 0.6


def test_a_box_that_does_not_hold_its_image_is_none(tmp_path: Path) -> None:
    """x' = x^2 from 1.1: x(t) = 1.1/(1 - 1.1 t), for which one enlargement is not enough."""
    model = model_of(tmp_path, Thing("x * abs(x) + 0.0 * push", "w", lambda *_: (0, 0)), 5, 20, 0)
    flow = LocalFlow(model, (0, 1))
    still = (exact(0.0), exact(0.0))
    known = 0
    for time in np.linspace(0.05, 0.8, 40):
        box = [(exact(1.0), exact(1.1)), still]
        try:
            enclosure = flow.enclose(box, [], Fraction(0), Fraction(float(time)))
        except NotCertainError:
            continue
        known += 1
        assert float(enclosure.box[0][1]) >= 1.1 / (1 - 1.1 * time)
    assert known > 5
