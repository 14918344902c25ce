"""Finds the matrices of verification plants by evaluating the plants.

Purpose: `linear_model` gives, for monitors, x' (flows) or the next x (maps) = A x + B u + c + W d,
and the driven topics y = M x + m, for one combination of parameter values.
Non-goals: proofs: entries are binary64 as the interpreter computes them, nothing rounds outward
(`verify/grid/group_model.py` does that from enclosures).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator, with_part
from soter.language.model.types import (
    BoolType,
    EnumType,
    FloatType,
    IntType,
    default_value,
    leaves,
    positions,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.core.layout import Floats
    from soter.language.model.types import Type, Value
    from soter.verify.problem.problem import Leaf, Problem


PROBES = 4
AFFINE = 1e-9
"""Relative error that rounding may leave on an affine plant."""
QUADRATURE = 64


@dataclass(frozen=True, kw_only=True)
class LinearModel:
    """The matrices of rates (`kind` "flow") or next states ("map"); |d - d_mid| <= `d_max`."""

    kind: str
    a: Floats
    b: Floats
    c: Floats
    w: Floats
    d_mid: Floats
    d_max: Floats
    drives: Floats
    offset: Floats


@dataclass(frozen=True)
class AffineStep:
    """A step of a plant: x(h) = phi x + gamma u + c, with an error of at most `reach` per state."""

    phi: Floats
    gamma: Floats
    c: Floats
    reach: Floats


# ---------------------------------------------------------------- evaluating


class Plants:
    """The verification plants of a problem as functions of vectors."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        q = problem.quantities
        self.states, self.controls = q.states, q.controls
        self.disturbances, self.parameters = q.disturbances, q.parameters
        self.plants = [x for x in problem.system.components if x.plant is not None]
        self.evaluators = {x.index: Evaluator.for_scope(x.scope) for x in self.plants}
        self.driven = driven_leaves(problem)

    def _environments(
        self, x: Floats, u: Floats, d: Floats, parameter: Sequence[int]
    ) -> dict[int, Any]:
        """The environments of the plants by component index; uncontrolled topics have defaults."""
        system = self.problem.system
        topics = [t.default for t in system.topics]
        for leaf, value in zip(self.controls, u, strict=True):
            t = system.topics[leaf.owner].type
            topics[leaf.owner] = value_with_leaf(t, topics[leaf.owner], leaf.path, float(value))
        environments = {}
        for c in self.plants:
            assert c.plant is not None
            env = Environment(topics=topics)
            for variable, initial in zip(c.plant.states, c.initial, strict=True):
                env.variables[variable] = initial
            for dist in c.disturbances:
                env.variables[dist.variable] = default_value(dist.variable.type)
            self._fill_variables(c.index, env, self.states, [float(v) for v in x])
            self._fill_variables(c.index, env, self.parameters, list(parameter))
            self._fill_variables(c.index, env, self.disturbances, [float(v) for v in d])
            for variable, e in c.plant.lets:
                env.variables[variable] = self.evaluators[c.index].compiled(e)(env)
            environments[c.index] = env
        return environments

    def _fill_variables(
        self, owner: int, env: Environment, leaves_: Sequence[Leaf], values: list[Any]
    ) -> None:
        known = {v.name: v for v in env.variables}
        for leaf, value in zip(leaves_, values, strict=True):
            if leaf.owner == owner:
                v = known[leaf.member]
                env.variables[v] = value_with_leaf(v.type, env.variables[v], leaf.path, value)

    def state_rates(self, x: Floats, u: Floats, d: Floats, parameter: Sequence[int]) -> Floats:
        """Rates, or next states, (states,), at x (states,), u (controls,), d (disturbances,)."""
        envs = self._environments(x, u, d, parameter)
        out = []
        for leaf in self.states:
            c = self.problem.system.components[leaf.owner]
            assert c.plant is not None
            v = next(v for v in c.plant.states if v.name == leaf.member)
            e = c.plant.der.get(v) or c.plant.next.get(v)
            if e is None:
                out.append(0.0)
                continue
            value = self.evaluators[leaf.owner].compiled(e)(envs[leaf.owner])
            out.append(leaf_number(v.type, value, leaf.path))
        return np.array(out, dtype=np.float64)

    def discrete_output(self, topic: int, path: Sequence[str], parameter: Sequence[int]) -> int:
        """The value of a discrete leaf of a driven topic when all states are 0."""
        t = self.problem.system.topics[topic].type
        return int(
            leaf_number(t, self._driven_topics(np.zeros(len(self.states)), parameter)[topic], path)
        )

    def driven_outputs(self, x: Floats, parameter: Sequence[int]) -> Floats:
        """The driven float leaves (leaves,) at state x (states,), ordered as `driven_leaves`."""
        values = self._driven_topics(x, parameter)
        topics = self.problem.system.topics
        outputs = [leaf_number(topics[t].type, values[t], path) for t, path in self.driven]
        return np.array(outputs, dtype=np.float64)

    def _driven_topics(self, x: Floats, parameter: Sequence[int]) -> dict[int, Value]:
        zero = [np.zeros(len(p)) for p in (self.controls, self.disturbances)]
        envs = self._environments(x, zero[0], zero[1], parameter)
        values: dict[int, Value] = {}
        for c in self.plants:
            assert c.plant is not None
            for topic, e in c.plant.drives:
                index = c.scope.topics[topic]
                values[index] = self.evaluators[c.index].compiled(e)(envs[c.index])
        return values


def driven_leaves(problem: Problem) -> list[tuple[int, tuple[str, ...]]]:
    """The topic and path of every float leaf that verification plants drive."""
    leaf_paths = []
    for c in problem.system.components:
        if c.plant is not None:
            for topic, _ in c.plant.drives:
                index = c.scope.topics[topic]
                for path, t in leaves(topic.type):
                    if isinstance(t, FloatType) and "[]" not in path:
                        leaf_paths.append((index, path))
    return leaf_paths


def leaf_number(t: Type, value: Value, path: Sequence[str]) -> float:
    """The number at a path of a value."""
    for i in positions(t, path):
        value = value[i]
    return float(value)


def value_with_leaf(t: Type, value: Value, path: Sequence[str], new: Value) -> Value:
    """The value with `new` at a path."""
    at = positions(t, path)
    return with_part(value, at, new) if at else new


# ---------------------------------------------------------------- matrices


def linear_model(problem: Problem, parameter: Sequence[int]) -> LinearModel:
    """Finds the matrices of the plants; raises SoterError U001 if a plant is not affine."""
    plants = Plants(problem)
    n, m, k = (len(p) for p in (plants.states, plants.controls, plants.disturbances))
    zero = np.zeros(n + m + k)

    def rates(z: Floats) -> Floats:
        return plants.state_rates(z[:n], z[n : n + m], z[n + m :], parameter)

    def outputs(z: Floats) -> Floats:
        return plants.driven_outputs(z[:n], parameter)

    parts = []
    for f, size in ((rates, n + m + k), (outputs, n)):
        base = f(zero)
        columns = [f(np.eye(n + m + k)[i]) - base for i in range(size)]
        jacobian = np.array(columns).T.reshape(len(base), size)
        for z in np.random.default_rng(0).uniform(-1, 1, (PROBES, n + m + k)):
            found, wanted = f(z), base + jacobian @ z[:size]
            scale = np.abs(jacobian).sum(axis=1) + np.abs(base) + 1e-300
            if not np.all(np.abs(found - wanted) <= AFFINE * scale):
                raise not_affine_error(problem)
        parts.append((jacobian, base))
    (full, c), (drives, offset) = parts
    ranges = problem.disturbances
    mid = np.array([r.low / 2 + r.high / 2 for r in ranges])
    half = np.array([r.high / 2 - r.low / 2 for r in ranges])
    return LinearModel(
        kind=problem.kind,
        a=full[:, :n],
        b=full[:, n : n + m],
        c=c,
        w=full[:, n + m :],
        d_mid=mid,
        d_max=half,
        drives=drives,
        offset=offset,
    )


def not_affine_error(problem: Problem) -> SoterError:
    """The SoterError U001 that a module's plants are not affine, so no monitor follows them."""
    message = f"the plants of module `{problem.name}` are not affine"
    notes = ("the monitor follows x' = A x + B u + c + W d, and maps of that form",)
    return SoterError((Diagnostic("U001", message, notes=notes),))


def matrix_exponential(a: Floats) -> Floats:
    """Computes e^a by scaling and squaring; (n, n) -> (n, n)."""
    size = float(np.abs(a).sum(axis=1).max(initial=0.0))
    doublings = max(0, int(np.ceil(np.log2(size))) + 4) if size > 0 else 0
    b = a / 2.0**doublings
    result = term = np.eye(len(a))
    for i in range(1, 14):
        term = term @ b / i
        result = result + term
    for _ in range(doublings):
        result = result @ result
    return result


def discretised_step(model: LinearModel, h: float) -> AffineStep:
    """The step of a flow over `h` seconds with constant u and any d, or one step of a map."""
    n, m = len(model.a), model.b.shape[1]
    c = model.c + model.w @ model.d_mid
    if model.kind == "map":
        return AffineStep(model.a, model.b, c, np.abs(model.w) @ model.d_max)
    full = np.zeros((n + m + 1, n + m + 1))
    full[:n, :n], full[:n, n : n + m], full[:n, n + m] = model.a, model.b, c
    e = matrix_exponential(full * h)
    reach = np.zeros(n)
    piece = matrix_exponential(model.a * (h / QUADRATURE))
    at = matrix_exponential(model.a * (h / QUADRATURE / 2))
    for _ in range(QUADRATURE):  # midpoints
        reach += np.abs(at @ model.w) @ model.d_max * (h / QUADRATURE)
        at = at @ piece
    return AffineStep(e[:n, :n], e[:n, n : n + m], e[:n, n + m], reach)


def parameter_leaves(problem: Problem) -> list[tuple[int, tuple[str, ...]]]:
    """For each parameter, the driven leaf that equals it; raises U001 if no leaf equals it."""
    plants = Plants(problem)
    cases = list(product(*(p.values for p in problem.parameters)))
    leaf_paths: list[tuple[int, tuple[str, ...]]] = []
    for i, parameter in enumerate(problem.parameters):
        for index, path in _discrete_leaves(problem):
            if all(plants.discrete_output(index, path, case) == case[i] for case in cases):
                leaf_paths.append((index, path))
                break
        if len(leaf_paths) <= i:
            message = f"no driven topic shows the parameter `{parameter.name}`"
            raise SoterError((Diagnostic("U001", message),))
    return leaf_paths


def _discrete_leaves(problem: Problem) -> list[tuple[int, tuple[str, ...]]]:
    return [
        (c.scope.topics[topic], path)
        for c in problem.system.components
        if c.plant is not None
        for topic, _ in c.plant.drives
        for path, t in leaves(topic.type)
        if isinstance(t, (IntType, BoolType, EnumType))
    ]
