"""Holes put back into the prover by hand, each with modules on which it matters.

Purpose: `HOLES`: a name, what to patch while the module is proved, and random modules made so that
the hole is what they rest on. The adversary must find a run that leaves C on a module that the
prover with the hole calls proved and the prover as it is does not.
Non-goals: holes in the re-checker.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from bench.adversary import proofs as adversary_proofs
from bench.adversary.random_modules import Module, PathNode, Times

from soter.verify.claims import start
from soter.verify.grid import sets as grids
from soter.verify.grid.grid_problem import grid_inputs_of
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.schedule import Schedule, SensorPath

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Rng = np.random.Generator


@dataclass(frozen=True)
class Hole:
    """`patches`: (object, attribute, what stands there instead)."""

    name: str
    patches: tuple[tuple[Any, str, Any], ...]
    make: Callable[[Rng], Module]
    shape: str = "written"
    """What stands at the border: "written" predicates, the "start", or "computed" ones."""

    @contextmanager
    def open(self) -> Iterator[None]:
        """The prover has the hole."""
        with ExitStack() as stack:
            for where, name, value in self.patches:
                stack.enter_context(patch.object(where, name, value))
            yield


def _derived(f: Callable[[Schedule], int]) -> property:
    return property(f)


# ---------------------------------------------------------------- modules


def _round(x: float) -> float:
    return float(f"{float(x):.3g}")


def border_tank(
    rng: Rng,
    when: Times,
    *,
    speed: float = 2.0,
    wind: float = 0.0,
    error: float = 0.0,
    force: float = 1.0,
    **more: Any,  # noqa: ANN401 - fields of Module
) -> Module:
    """X' = u + w; SC pushes back as hard as it may but near the middle."""
    control = _round(speed * rng.uniform(0.7, 1.3))
    stiff = _round(control * rng.uniform(2.0, 6.0))
    return Module(
        int(rng.integers(2**31)),
        "tank",
        ((0.0,),),
        ((1.0,),),
        (((stiff,),),),
        (_round(force * control),),
        (control,),
        (_round(wind * control),),
        (error,),
        (1.0,),
        when,
        (400,),
        first=(control,),
        **more,
    )


def _late_dm(rng: Rng) -> Module:
    late = int(rng.integers(10, 25))
    return border_tank(rng, Times(50, 50, 1, 1, 0, late_dm=late, response_dm=24 - late), speed=3.0)


def _slow_actuator(rng: Rng) -> Module:
    return border_tank(rng, Times(40, 40, 1, 1, acts=int(rng.integers(12, 20))), speed=3.0)


def _out_of_step(rng: Rng) -> Module:
    return border_tank(rng, Times(40, 40, 1, 1, sc_phase=int(rng.integers(25, 39))), speed=3.0)


def _on_time(rng: Rng) -> Module:
    return border_tank(rng, Times(int(rng.choice([40, 60])), 20, 1, 1), speed=3.0)


def _old_reads(rng: Rng) -> Module:
    return border_tank(rng, Times(50, 50, 40, 40, late_dm=int(rng.integers(20, 25))), speed=3.0)


def _noisy(rng: Rng) -> Module:
    return border_tank(rng, Times(20, 20, 1, 1), speed=1.0, error=_round(rng.uniform(0.03, 0.08)))


def _windy(rng: Rng) -> Module:
    wind = rng.uniform(1.1, 1.5)
    return border_tank(rng, Times(20, 20, 1, 1), speed=0.5, wind=wind)


def _silent(rng: Rng) -> Module:
    quiet = int(rng.integers(80, 150)) * 10
    return border_tank(rng, Times(20, 20, 10, 10, dropout=quiet), speed=2.0)


def _rare(rng: Rng) -> Module:
    return border_tank(rng, Times(20, 20, int(rng.integers(8, 14)) * 100, 10), speed=2.0)


def _slow_node(rng: Rng) -> Module:
    took = int(rng.integers(80, 98))
    nodes = (PathNode(100, 0, 0, took), PathNode(100, took + 1, 0, took))
    return border_tank(rng, Times(20, 20, 10, 100 + took), speed=2.0, nodes=nodes)


def _first_read(rng: Rng) -> Module:
    node = PathNode(100, int(rng.integers(60, 90)), 0, 0)
    module = border_tank(rng, Times(20, 20, 10, 100), speed=1.2, nodes=(node,))
    side = float(rng.uniform(0.3, 0.5))
    return replace(module, bias=(_round(side * module.gain[0][0][0]),))


def _late_start(rng: Rng) -> Module:
    late = int(rng.integers(10, 25))
    return border_tank(rng, Times(100, 50, 1, 1, late_dm=late, response_dm=24 - late), speed=2.0)


def _phase_start(rng: Rng) -> Module:
    return border_tank(rng, Times(40, 40, 1, 1, sc_phase=int(rng.integers(25, 39))), speed=2.0)


def _mode(rng: Rng, **when: int) -> Module:
    """A mode that nothing damps but an SC that only just does, while it acts on time."""
    omega, sc = _round(rng.uniform(22.0, 27.0)), 50
    force = _round(rng.uniform(0.7, 1.0))
    stiff = force * rng.uniform(0.6, 0.8)
    turn = omega * 1e-3 * 0.5 * sc - rng.uniform(1.15, 1.3)
    law = (_round(-stiff * np.sin(turn)), _round(stiff * np.cos(turn)))
    return Module(
        int(rng.integers(2**31)),
        "mode",
        ((0.0, omega), (-omega, 0.0)),
        ((0.0,), (1.0,)),
        ((law,),),
        (force,),
        (force,),
        (0.0, 0.0),
        (0.0, 0.0),
        (1.0, 1.0),
        Times(**{"dm": sc, "sc": sc, "sensor": 1, "max_age": 1, **when}),
        (80, 80),
        levels=2,
    )


def _waiting_mode(rng: Rng) -> Module:
    return _mode(rng, late_dm=int(rng.integers(36, 46)))


def _late_mode(rng: Rng) -> Module:
    return _mode(rng, late_sc=int(rng.integers(36, 46)))


def _old_mode(rng: Rng) -> Module:
    return _mode(rng, sensor=50, max_age=50, sc_phase=int(rng.integers(35, 50)))


# ---------------------------------------------------------------- patches


def _jitter_without_wait(s: Schedule) -> int:
    late = s.sc.late + s.sc.response
    return max(o.time_to_effect(s.sc, late) for o in s.outputs) - min(
        o.least_time_to_effect(s.sc) for o in s.outputs
    )


def _start_without_wait(s: Schedule) -> int:
    first = s.sc.phase
    for path in s.read_by_sc:
        first = max(first, s.sc.first_release_from(path.available_from, after=bool(path.nodes)))
    return first + max(o.time_to_effect(s.sc, s.sc.late + s.sc.response) for o in s.outputs)


def _start_of_defaults(s: Schedule) -> int:
    late = s.latest_start_of_sc + s.sc.response
    return s.sc.phase + max(o.time_to_effect(s.sc, late) for o in s.outputs)


def _h_star(
    s: Schedule,
    *,
    age: bool = True,
    period: bool = True,
    wait: bool = True,
    dm: bool = True,
    acts: bool = True,
) -> int:
    """H* without nodes behind the module, less what is left out."""
    handing = max(s.dm.latest if dm else 0, (s.longest_to_sc if wait else 0) + s.sc.late)
    horizon = handing + s.sc.response + (max(o.most for o in s.outputs) if acts else 0)
    return horizon + (s.age_dm if age else 0) + (s.dm.period if period else 0)


def _without(name: str) -> tuple[Any, str, Any]:
    return (Schedule, "h_star", _derived(lambda s: _h_star(s, **{name: False})))


def _stamps_only(s: Schedule) -> int:
    return max((p.max_age or 0) + p.published_age for p in s.read_by_sc)


_TRUTH = GridGroup.truth_bits


def _truth_without_errors(self: GridGroup, predicate: str, *, ranges: Any = None) -> Any:  # noqa: ANN401
    """Predicates see what is, not what is measured."""
    x = self.inputs
    first = len(x.states) + len(x.controls) + len(x.disturbances)
    exact = {first + i: (0.0, 0.0) for i in range(len(x.errors))}
    return _TRUTH(self, predicate, ranges={**(ranges or {}), **exact})


_OF_PROBLEM = grid_inputs_of


def _half(ranges: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return tuple((0.5 * low, 0.5 * high) for low, high in ranges)


def _half_the_wind(problem: Any, parameters: Any = ()) -> Any:  # noqa: ANN401
    inputs = _OF_PROBLEM(problem, parameters)
    return replace(inputs, disturbances=_half(inputs.disturbances))


_SAFE_FOR = GridGroup.cells_safe_for


def _half_the_commands(self: GridGroup, t_ns: int, target: Any, **more: Any) -> Any:  # noqa: ANN401
    """R(H) for half of the time is R(H) of an integrator for half of U."""
    return _SAFE_FOR(self, t_ns // 2, target, **more)


NO_DEFAULTS = (start, "fault_on_defaults", lambda _: "")
HOLES = (
    Hole(
        "j without the wait for the DM",
        ((Schedule, "jitter", _derived(_jitter_without_wait)),),
        _waiting_mode,
        "computed",
    ),
    Hole(
        "h_0 without the wait for the DM",
        ((Schedule, "start", _derived(_start_without_wait)),),
        _late_start,
        "start",
    ),
    Hole(
        "the first read may be a default",
        ((Schedule, "start", _derived(_start_of_defaults)), NO_DEFAULTS),
        _first_read,
        "start",
    ),
    Hole(
        "R011 is not asked",
        (
            (Schedule, "age_sc", _derived(_stamps_only)),
            (Schedule, "stamp_age_sc", lambda *_: 0),
        ),
        _rare,
    ),
    Hole(
        "the age on the way through nodes is ignored",
        (
            (SensorPath, "published_age", property(lambda _: 0)),
            (SensorPath, "state_age", lambda self, reader, late: self.stamp_age(reader, late)),
        ),
        _slow_node,
    ),
    Hole(
        "measurement errors are ignored in ttf and safer",
        (
            (GridGroup, "truth_bits", _truth_without_errors),
            (adversary_proofs, "errors_by_state", lambda _: {}),
        ),
        _noisy,
    ),
    Hole(
        "SC's delay d is zero",
        ((Schedule, "delay", _derived(lambda _: 0)),),
        _old_mode,
        "computed",
    ),
    Hole("actuation latency is left out of H*", (_without("acts"),), _slow_actuator),
    Hole("the wait for SC's release, G, is left out of H*", (_without("wait"),), _out_of_step),
    Hole("the DM's lateness and response are left out of H*", (_without("dm"),), _late_dm),
    Hole(
        "the jitter j is zero",
        ((Schedule, "jitter", _derived(lambda _: 0)),),
        _late_mode,
        "computed",
    ),
    Hole("half of the disturbance", ((grids, "grid_inputs_of", _half_the_wind),), _windy),
    Hole("R(H) for H less the DM's period", (_without("period"),), _on_time),
    Hole("the DM's age A is ignored", (_without("age"),), _old_reads),
    Hole(
        "drop-outs add nothing to the age",
        ((Schedule, "_with_dropout", lambda _, paths: paths),),
        _silent,
    ),
    Hole(
        "half of what AC may command",
        ((GridGroup, "cells_safe_for", _half_the_commands),),
        _on_time,
    ),
    Hole("h_0 is zero", ((Schedule, "start", _derived(lambda _: 0)),), _phase_start, "start"),
)
