"""Shields that are wrong, each in a way of its own.

Purpose: `OF_PROVER` (slips of the prover, with modules on which they matter), `OF_DM` and
`OF_TABLES` (slips of what makes the DM, and its tables), `REFUSED` (changes of a program that has a
proof, after which it must have none).
Non-goals: wrong implementations of the gate (`closed_loop.SLIPS`), who notices
(`against_shields.py`).
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from bench.adversary.module_families import FAMILIES, of_commands
from bench.adversary.prover_holes import border_tank
from bench.adversary.random_modules import Times

from soter.language.model.typed import Literal
from soter.language.model.types import BOOL
from soter.verify.deploy import missing_predicates, shield_tables
from soter.verify.grid import estimate_sets
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.schedule import Schedule

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.adversary.random_modules import Module

    Rng = np.random.Generator
    Patches = tuple[tuple[Any, str, Any], ...]

PROGRAM = """soter 1;
topic at: float max_age 20ms;
topic speed: float in [-1.0, 1.0];
node Any period 10ms { publishes speed; step { publish speed = sin(5.0 * time); } }
node Back period 10ms {
  subscribes at;
  publishes speed;
  step { publish speed = clamp(-2.0 * at, -1.0, 1.0); }
}
plant Cart period 5ms {
  reads speed;
  drives at = x;
  state x: float;
  disturbance slip: float in [-0.1, 0.1];
  der x = speed + slip;
  measured at within 0.05;
}
rta Keep {
  ac Any;
  sc Back;
  period 50ms;
  safe at < 2.0 && at > -3.0;
  shield 4;
  verify { grid at in [-3.0, 2.0] / 250; late dm 1ms, sc 1ms; acts within 2ms; }
}
system S { c: Cart; module Keep; until 5s; }
"""


@contextmanager
def patched(patches: Patches) -> Iterator[None]:
    """(object, attribute, what stands there instead) for as long as this is open."""
    with ExitStack() as stack:
        for where, name, value in patches:
            stack.enter_context(patch.object(where, name, value))
        yield


# ---------------------------------------------------------------- modules


def late_to_act(rng: Rng) -> Module:
    """A command acts long after the next one was published."""
    return _fine(border_tank(rng, Times(40, 40, 1, 1, acts=19), speed=3.0))


def moved_toward_sc(rng: Rng) -> Module:
    """The same, where commands are moved toward SC's."""
    return replace(late_to_act(rng), toward=True)


def out_of_step(rng: Rng) -> Module:
    """The same, where a look may come soon after a release of SC."""
    return _fine(border_tank(rng, Times(44, 40, 1, 1, acts=19), speed=3.0))


def late_and_old(rng: Rng) -> Module:
    """The same, on estimates that are nearly as old as a look is long ago."""
    return _fine(border_tank(rng, Times(55, 40, 40, 40, acts=19), speed=2.0))


def old_reads(rng: Rng) -> Module:
    """Estimates are nearly a period old."""
    return _fine(border_tank(rng, Times(50, 50, 40, 40, late_dm=20), speed=2.0))


def noisy(rng: Rng) -> Module:
    """Estimates with large errors."""
    return _fine(border_tank(rng, Times(20, 20, 1, 1, acts=5), speed=1.0, error=0.06))


def windy(rng: Rng) -> Module:
    """A wind nearly as strong as the commands."""
    return _fine(border_tank(rng, Times(40, 20, 1, 1, acts=5), speed=1.0, wind=0.8))


def two_axes(rng: Rng) -> Module:
    """Two groups."""
    return of_commands(FAMILIES["pair"](int(rng.integers(100)), rng), rng)


def _fine(module: Module) -> Module:
    return replace(module, family="border", cells=(800,), shield=4)


# ---------------------------------------------------------------- slips of the prover


@dataclass(frozen=True)
class OfProver:
    """`patches` while it is proved; `table`: what is wrong stands in the certificate."""

    name: str
    patches: Patches
    make: Callable[[Rng], Module]
    table: bool = True


class _Asked:
    """A group of which a prover with a slip in it asks."""

    def __init__(self, group: Any, spared: Callable[[Any], int]) -> None:  # noqa: ANN401
        self.group, self.spared = group, spared

    def cells_safe_for(self, horizon: Any, core: Any) -> Any:  # noqa: ANN401
        return self.group.cells_safe_for(max(horizon - self.spared(self.group), 1), core)


_between = estimate_sets.engine_with_command_in


def _sooner(spared_ns: Callable[[Any], int]) -> Any:  # noqa: ANN401
    """Looks ahead for less than H."""
    return lambda *box: _Asked(_between(*box), spared_ns)


def _half_as_wide(engine: Any, control: int, low: float, high: float) -> Any:  # noqa: ANN401
    quarter = 0.25 * (high - low)
    return _between(engine, control, low + quarter, high - quarter)


def _a_cell_lower(engine: Any, control: int, low: float, high: float) -> Any:  # noqa: ANN401
    limits = engine.inputs.controls[control]
    cell = (limits[1] - limits[0]) / 4
    return _between(engine, control, max(low - cell, limits[0]), high - cell)


def _calm(engine: Any, control: int, low: float, high: float) -> Any:  # noqa: ANN401
    still = tuple((0.0, 0.0) for _ in engine.inputs.disturbances)
    group = _between(engine, control, low, high)
    return GridGroup(
        group.library,
        replace(group.inputs, disturbances=still),
        list(zip(group.axes, group.edges, strict=True)),
        threads=group.threads,
    )


def _acted(*, age: bool = True, acts: bool = True, untold: bool = True) -> Patches:
    """W less what is left out."""

    def shorter(s: Schedule) -> int:
        total = s.age_dm if age else 0
        total += max(o.most for o in s.outputs) if acts else 0
        return total + (s.sc.period + s.latest_start_of_sc if untold else 0)

    return ((Schedule, "replaced_window", property(shorter)),)


def _box(between: Any) -> Patches:  # noqa: ANN401
    return ((estimate_sets, "engine_with_command_in", between),)


MS = 1_000_000
OF_PROVER = (
    OfProver("W without L", _acted(acts=False), out_of_step, table=False),
    OfProver("W without what is published late", _acted(untold=False), out_of_step, table=False),
    OfProver("W without A", _acted(age=False), late_and_old, table=False),
    OfProver(
        "W is zero",
        ((Schedule, "replaced_window", property(lambda _: 0)),),
        late_to_act,
        table=False,
    ),
    OfProver(
        "errors are not subtracted", ((estimate_sets, "errors_by_state", lambda _: {}),), noisy
    ),
    OfProver("H less L", _box(_sooner(lambda _: 19 * MS)), late_to_act),
    OfProver("H less the DM's period", _box(_sooner(lambda _: 40 * MS)), late_to_act),
    OfProver("H less A", _box(_sooner(lambda _: 40 * MS)), old_reads),
    OfProver("V is half as wide as its cells", _box(_half_as_wide), late_to_act),
    OfProver("V is of the cells one further down", _box(_a_cell_lower), late_to_act),
    OfProver("no wind while a command acts", _box(_calm), windy),
)


# ---------------------------------------------------------------- slips of the DM and its tables


def _forgetful(self: Any) -> Any:  # noqa: ANN401
    """Looks at the first cell only for what was held."""
    cells, self.cells = self.cells, 1
    fun = _ends(self)
    self.cells = cells
    return fun


def _silent(problem: Any, *rest: Any) -> Any:  # noqa: ANN401
    held, permits, ttf = _expressions(problem, *rest)
    return held, permits, Literal(BOOL, ttf.span, False)


def _elsewhere(low: float, high: float, cells: int) -> tuple[float, ...]:
    return tuple(e + 0.01 for e in _edges(low, high, cells))


_ends, _edges = shield_tables.ShieldWriter.ends_function, shield_tables.command_edges
_expressions = shield_tables.shield_expressions
OF_DM: dict[str, Patches] = {
    "the DM forgets what was held": ((shield_tables.ShieldWriter, "ends_function", _forgetful),),
    "the DM does not look at what is held": ((missing_predicates, "shield_expressions", _silent),),
    "the DM forgets 2 ms too soon": ((shield_tables, "SLACK_NS", -2 * MS),),
    "the DM's command cells lie elsewhere": ((shield_tables, "command_edges", _elsewhere),),
}


def _damaged(damage: Callable[[Any, int], None]) -> Patches:
    """Tables that are damaged once they were computed."""
    find = estimate_sets.find_permitted_commands

    def wrong(case: Any, proof: Any, engine: Any, part: Any, anywhere: Any) -> None:  # noqa: ANN401
        find(case, proof, engine, part, anywhere)
        damage(part.tops, part.tops.shape[-1])

    return ((estimate_sets, "find_permitted_commands", wrong),)


def _longer(tops: Any, n: int) -> None:  # noqa: ANN401
    for i in range(n):
        some = tops[..., i] > i
        tops[some, i] = np.minimum(n, tops[some, i] + 1)


def _everywhere(tops: Any, n: int) -> None:  # noqa: ANN401
    tops[...] = n


def _moved(tops: Any, n: int) -> None:  # noqa: ANN401
    del n
    tops[6:] = tops[:-6].copy()


def _mirrored(tops: Any, n: int) -> None:  # noqa: ANN401
    tops[...] = np.where(tops > 0, n, 0)[..., ::-1]


OF_TABLES: dict[str, Patches] = {
    "a table permits a cell more": _damaged(_longer),
    "a table permits all": _damaged(_everywhere),
    "a table lies six cells further on": _damaged(_moved),
    "a table takes up for down": _damaged(_mirrored),
}


# ---------------------------------------------------------------- programs that have no proof

MODEL = """plant Model period 5ms {
  reads speed;
  drives at = x;
  state x: float;
  disturbance slip: float in [-0.1, 0.1];
  der x = speed + slip;
  measured at within 0.05;
}
"""
LIMIT = """topic slow: float in [-1.0, 1.0];
node Limit period 5ms {
  subscribes speed, at;
  publishes slow;
  var v: float;
  step { v = clamp(v + clamp(speed - v, -0.1, 0.1), -1.0, 1.0); publish slow = at > 9.0 ? 0.0 : v; }
}
"""
REFUSED: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "memory behind the gate: a controller that limits rates": (
        "R007",
        (
            ("reads speed;", "reads slow;"),
            ("der x = speed", "der x = slow"),
            ("grid at", "abstracts c by q: Model = { x: c.truth.x };\n  grid at"),
            ("rta Keep", MODEL + "rta Keep"),
            ("plant Cart", LIMIT + "plant Cart"),
            ("module Keep;", "module Keep; node Limit;"),
        ),
    ),
    "an SC that reads what the DM does not": (
        "R007",
        (
            ("topic speed", "topic told: float max_age 20ms;\ntopic speed"),
            ("drives at = x;", "drives at = x;\n  drives told = x;"),
            ("subscribes at;\n", "subscribes told;\n"),
            ("clamp(-2.0 * at,", "clamp(-2.0 * told,"),
        ),
    ),
    "a topic that says no age": ("R011", (("topic at: float max_age 20ms;", "topic at: float;"),)),
    "predicates beside it that somebody wrote": (
        "M027",
        (("shield 4;", "shield 4; ttf at > 1.0; safer at < 0.0;"),),
    ),
    "an AC whose steps take time": (
        "M027",
        (
            (
                "publishes speed; step { publish speed = sin",
                "publishes speed; takes [1ms, 2ms]; step { publish speed = sin",
            ),
        ),
    ),
    "an AC that overruns": (
        "M027",
        (("until 5s;", "until 5s; faults { overrun Keep.Any by 5ms at 60 per 1h; }"),),
    ),
    "an axis without ends": (
        "R007",
        (
            ("safe at < 2.0 && at > -3.0;", "safe at < 2.0;"),
            ("at in [-3.0, 2.0] / 250;", "at in [-3.0, 2.0] / 250 open;"),
        ),
    ),
    "more cells than there may be": ("C002", (("shield 4;", "shield 65;"),)),
    "no cell at all": ("C002", (("shield 4;", "shield 0;"),)),
}
