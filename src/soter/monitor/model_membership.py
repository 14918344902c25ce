"""Checks whether some run of the verification plants fits a record: the model monitor.

Purpose: `judge_run` follows a record by set-membership. X_k is the box of states that the model
allows at instant k: the image of X_(k-1) under the commands that acted, any disturbance within its
bounds and the time that passed, intersected with what the record shows of the state x_k:
the true state (error 0), or an estimate +-E. Where nothing is left the model is false: that is an
alarm, and X_k starts anew.
Non-goals: plants that are not affine; showing that a model is true: no alarm only says
that nothing has spoken against it. X_k is a box, so that it is never too small.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.monitor.linear_model import (
    AffineStep,
    Plants,
    discretised_step,
    driven_leaves,
    leaf_number,
    linear_model,
    parameter_leaves,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Floats
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Value
    from soter.monitor.linear_model import LinearModel
    from soter.monitor.log_files.log_columns import Damage
    from soter.simulate.run_log import RecordedRun
    from soter.verify.problem.problem import Problem


ROUNDING = 1e-9
"""Relative slack of every comparison: the recorded plant computes in binary64."""
UNSEEN = 1e-6
"""A leaf that moves a state by no more than this counts as one that the state does not need."""
SILENT = 10.0
"""A topic without `max_age` is silent after so many times the median of its own periods."""


@dataclass
class Judgement:
    """The findings on one module in one record. Shares are shares of the declared disturbance."""

    module: str
    source: str
    """"truth" or "estimates"."""
    steps: int = 0
    alarms: int = 0
    first_alarm_s: float | None = None
    share: float = 0.0
    """Largest share of what disturbances can do that a step used; beyond 1 the model is false."""
    state: str = ""
    """The state that needed the largest share."""
    alarm_states: dict[str, int] = field(default_factory=dict)
    judged_ns: int = 0
    """The sum of the lengths of the judged steps."""
    length_ns: int = 0
    """The length of the record."""
    empty_runs: int = 0
    """The number of runs, of several, in which no step was judged."""
    notes: tuple[str, ...] = ()
    """The parts of a log that were not used, and stamps of another clock, in words."""
    span: Span | None = field(default=None, compare=False, repr=False)
    """The place where the module is declared."""
    damage: Damage | None = None
    """The damage of the log, if any: only what stands before it was judged."""
    offsets: list[Floats] = field(default_factory=list, compare=False, repr=False)
    """For each step, how far the states, (states,), were from the middle of what the model allows,
    as a share of what bounds and errors allow. Beyond 1: an alarm. 0: the state is not known."""
    offset_times_s: list[float] = field(default_factory=list, compare=False, repr=False)
    alarm_times_s: list[float] = field(default_factory=list, compare=False, repr=False)
    state_names: tuple[str, ...] = field(default=(), compare=False, repr=False)
    modes: tuple[tuple[float, str], ...] = field(default=(), compare=False, repr=False)
    """Each change of control: its time in s, and the controller that got control."""

    @property
    def judged(self) -> bool:
        """Whether the record gives a verdict: an alarm, or at least a judged step in every run."""
        return (self.judged_ns > 0 or self.alarms > 0) and not self.empty_runs

    @property
    def judged_share(self) -> float:
        """The share of the record that was judged, by time."""
        return min(1.0, self.judged_ns / max(1, self.length_ns))


class Models:
    """Makes the model's matrices once for parameter values, and its steps once for each length."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._models: dict[tuple[int, ...], LinearModel] = {}
        self._steps: dict[tuple[tuple[int, ...], int], AffineStep] = {}
        self._plants = Plants(problem)

    def matrices(self, parameter: tuple[int, ...]) -> LinearModel:
        """The matrices of the plants at these values of their parameters."""
        if parameter not in self._models:
            self._models[parameter] = linear_model(self.problem, parameter)
        return self._models[parameter]

    def step_of_length(self, parameter: tuple[int, ...], ns: int) -> AffineStep:
        """The model's step of `ns` nanoseconds."""
        key = (parameter, ns)
        if key not in self._steps:
            self._steps[key] = discretised_step(self.matrices(parameter), ns / 1e9)
        return self._steps[key]

    def step_around(self, parameter: tuple[int, ...], ns: int, x: Floats, u: Floats) -> AffineStep:
        """A step of `ns` nanoseconds; for a map, the tangent at x (states,), u (controls,)."""
        if self.problem.kind != "map":
            return self.step_of_length(parameter, ns)
        low = np.array([r.low for r in self.problem.disturbances])
        high = np.array([r.high for r in self.problem.disturbances])
        middle = low / 2 + high / 2
        centre = self._plants.state_rates(x, u, middle, parameter)
        reach = np.zeros(len(x))
        for i in range(len(middle)):
            ends = []
            for d in (low, high):
                moved = middle.copy()
                moved[i] = d[i]
                ends.append(np.abs(self._plants.state_rates(x, u, moved, parameter) - centre))
            reach += np.maximum(*ends)
        still = np.zeros((len(x), len(x)))
        return AffineStep(still, np.zeros((len(x), len(u))), centre, reach)


# ---------------------------------------------------------------- on true states


class RecordReader:
    """Reads states, parameters and commands of the verification plants off a record."""

    def __init__(self, flat: System, module: Module, problem: Problem) -> None:
        self.flat, self.problem = flat, problem
        q = problem.quantities
        self.states, self.controls, self.parameters = q.states, q.controls, q.parameters
        self.links = module.symbol.verify.abstracts
        home = module.name.rpartition(".")[0]
        self.prefix = f"{home}." if home else ""
        system = problem.system
        self.names = flying_topic_names(flat, module, problem)
        self.plants = {c.name: c for c in system.components if c.plant is not None}
        self.driven = [
            flat.topics[c.scope.topics[t]].name
            for c in flat.components
            if c.plant is not None
            for t, _ in c.plant.drives
        ]
        self._compiled = []
        for link in self.links:
            if link.value is not None:
                scope = module.scope
                flying = {self.prefix + link.instance: flat.component(self.prefix + link.instance)}
                ((name, component),) = flying.items()
                evaluator = Evaluator(
                    module.scope.params,
                    topics=_scope_topics(flat, module),
                    plants={link.instance: component.index},
                    modules=scope.modules,
                )
                self._compiled.append((link, name, component, evaluator.compiled(link.value)))

    def true_state(
        self, topics: Mapping[str, Value], truths: Mapping[str, Value]
    ) -> tuple[Floats, tuple[int, ...]]:
        """The true state, (states,), and the values of the parameters."""
        values: dict[str, Value] = {}
        if self.links:
            listed = [topics.get(t.name, t.default) for t in self.flat.topics]
            for link, name, _component, compiled in self._compiled:
                env = Environment(topics=listed, truth=lambda _i, n=name: truths[n])  # type: ignore[misc]
                values[link.name] = compiled(env)
        else:
            values = {c.name: truths[n] for n, c in self.plants.items()}
        return self._state_and_parameters(values)

    def _state_and_parameters(self, values: Mapping[str, Value]) -> tuple[Floats, tuple[int, ...]]:
        system = self.problem.system

        def leaf_value(leaf: object) -> float:
            c = system.components[leaf.owner]  # type: ignore[attr-defined]
            assert c.plant is not None
            state = values[c.name]
            at = [v.name for v in c.plant.states].index(leaf.member)  # type: ignore[attr-defined]
            return leaf_number(c.plant.states[at].type, state[at], leaf.path)  # type: ignore[attr-defined]

        x = np.array([leaf_value(leaf) for leaf in self.states])
        return x, tuple(int(leaf_value(leaf)) for leaf in self.parameters)

    def topics_before_nodes(self, record: RecordedRun, k: int) -> Mapping[str, Value]:
        """The topics at instant k when the plants have moved and no node has stepped yet."""
        first = record.before or {t.name: t.default for t in self.flat.topics}
        previous = record.topics[k - 1] if k else first
        return {**previous, **{n: record.topics[k][n] for n in self.driven}}

    def parameters_in_topics(
        self, places: Sequence[tuple[int, tuple[str, ...]]], topics: Mapping[str, Value]
    ) -> tuple[int, ...]:
        """The parameters' values, read from the topics at `places` (see `parameter_leaves`)."""
        known = self.problem.system.topics
        return tuple(
            int(leaf_number(known[i].type, topics[self.names[i]], path)) for i, path in places
        )

    def commands(self, topics: Mapping[str, Value]) -> Floats:
        """The commands that stand in the topics, (controls,)."""
        system = self.problem.system
        commands = []
        for leaf in self.controls:
            value = topics[self.names[leaf.owner]]
            commands.append(leaf_number(system.topics[leaf.owner].type, value, leaf.path))
        return np.array(commands)

    def driven_values(self, topics: Mapping[str, Value]) -> Floats:
        """The values of the driven float leaves in the topics, (leaves,)."""
        system = self.problem.system
        return np.array(
            [
                leaf_number(system.topics[t].type, topics[self.names[t]], path)
                for t, path in driven_leaves(self.problem)
            ]
        )


def _scope_topics(flat: System, module: Module) -> dict[TopicSymbol, int]:
    index_by_topic: dict[TopicSymbol, int] = {}
    for c in flat.components:
        index_by_topic.update(c.scope.topics)
    index_by_topic.update(module.scope.topics)
    return index_by_topic


def flying_topic_names(flat: System, module: Module, problem: Problem) -> dict[int, str]:
    """Maps topic indices of the verification system to the topics' names in the flying system."""
    symbols = {}
    for c in problem.system.components:
        symbols.update({i: s for s, i in c.scope.topics.items()})
    symbols.update({i: s for s, i in problem.module.scope.topics.items()})
    flying = _scope_topics(flat, module)
    return {i: flat.topics[flying[s]].name for i, s in symbols.items() if s in flying}


def needed_topics(flat: System, module: Module, problem: Problem) -> list[str]:
    """The full names of the topics that `judge_run` reads when there are no true states."""
    names = flying_topic_names(flat, module, problem)
    owners = [t for t, _ in driven_leaves(problem)] + [c.owner for c in problem.quantities.controls]
    return list(dict.fromkeys(names[i] for i in owners))


def judge_run(
    flat: System,
    module: Module,
    problem: Problem,
    record: RecordedRun,
    *,
    estimates: bool = False,
    truths: bool = True,
    models: Models | None = None,
) -> Judgement:
    """Judges a record by the model of a module. Raises U001 if the plants are not affine.

    `truths`: the record has true states; without true states, parameters are read from the topics.
    `models`: may be passed on if several records of one problem are judged. On true states of
    plants that move in steps (maps), only the instants at multiples of the plants' period are
    judged.
    """
    reader = RecordReader(flat, module, problem)
    models = models or Models(problem)
    source = "estimates" if estimates else "truth"
    judgement = Judgement(module.name, source, span=module.symbol.span)
    judgement.state_names = tuple(leaf.name for leaf in reader.states)
    judgement.modes = tuple((at_s, to) for at_s, m, to in record.modes if m == module.name)
    if record.times_ns:
        judgement.length_ns = record.times_ns[-1] - record.times_ns[0]
    if estimates:
        ages = _TopicAges(flat, needed_topics(flat, module, problem), record)
        _judge_on_estimates(reader, models, record, judgement, ages, truths=truths)
    else:
        _judge_on_truth(reader, models, record, judgement)
    return judgement


def note_alarm(judgement: Judgement, at_s: float, states: Sequence[str]) -> None:
    """Counts an alarm, and the states, or commands, that it is about."""
    judgement.alarms += 1
    judgement.alarm_times_s.append(at_s)
    first = judgement.first_alarm_s
    judgement.first_alarm_s = at_s if first is None else min(first, at_s)
    for name in states:
        judgement.alarm_states[name] = judgement.alarm_states.get(name, 0) + 1


def _judge_on_truth(
    reader: RecordReader, models: Models, record: RecordedRun, judgement: Judgement
) -> None:
    last: tuple[Floats, tuple[int, ...], Floats, int] | None = None
    names = [leaf.name for leaf in reader.states]
    period = models.problem.plant_period_ns if models.problem.kind == "map" else 0
    for k, now in enumerate(record.times_ns):
        if period and now % period:
            continue
        x, parameter = reader.true_state(reader.topics_before_nodes(record, k), record.truths[k])
        if last is not None and now > last[3]:
            before, same, u, then = last
            if same == parameter:
                step = models.step_around(same, now - then, before, u)
                judgement.judged_ns += now - then
                _judge_true_step(
                    step, before, u, x, judgement=judgement, record=record, k=k, names=names
                )
        last = x, parameter, reader.commands(record.topics[k]), now


def _judge_true_step(
    step: AffineStep,
    before: Floats,
    u: Floats,
    x: Floats,
    *,
    judgement: Judgement,
    record: RecordedRun,
    k: int,
    names: list[str],
) -> None:
    ahead = x - (step.phi @ before + step.gamma @ u + step.c)
    gap = np.abs(ahead)
    size = (
        np.abs(step.phi) @ np.abs(before)
        + np.abs(step.gamma) @ np.abs(u)
        + np.abs(x)
        + np.abs(step.c)
    )
    slack = ROUNDING * size
    over = np.maximum(gap - slack, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(over > 0, over / step.reach, 0.0)
        judgement.offsets.append(np.nan_to_num(ahead / (step.reach + slack)))
    judgement.offset_times_s.append(record.times_ns[k] / 1e9)
    judgement.steps += 1
    worst = int(np.argmax(shares))
    if shares[worst] > judgement.share:
        judgement.share, judgement.state = float(shares[worst]), names[worst]
    wrong = [names[i] for i in np.flatnonzero(shares > 1.0)]
    if wrong:
        note_alarm(judgement, record.times_ns[k] / 1e9, wrong)


# ---------------------------------------------------------------- on estimates


@dataclass(frozen=True)
class ObservationMap:
    """Maps the driven leaves y to states: x lies in inverse (y - offset) +- error."""

    inverse: Floats
    error: Floats


def observation_map(problem: Problem, model: LinearModel) -> ObservationMap:
    """The map from estimates to states; the error of a state that nothing shows is infinite."""
    errors = np.zeros(len(model.drives))
    at = {key: i for i, key in enumerate(driven_leaves(problem))}
    for leaf, r in zip(problem.quantities.errors, problem.errors, strict=True):
        errors[at[leaf.owner, leaf.path]] = r.high
    inverse = np.asarray(np.linalg.pinv(model.drives), dtype=np.float64)
    seen = np.abs(inverse @ model.drives - np.eye(len(model.a))).max(axis=1) < UNSEEN
    return ObservationMap(
        inverse, np.asarray(np.where(seen, np.abs(inverse) @ errors, np.inf), dtype=np.float64)
    )


class _TopicAges:
    """Says which topics were published at each instant, and which fell silent."""

    def __init__(self, flat: System, names: Sequence[str], record: RecordedRun) -> None:
        self.record, self.names = record, names
        self.last: dict[str, int] = {}
        self.most: dict[str, float] = {}
        """Topic -> the greatest age that counts as judged: `max_age`, or some of its periods."""
        for t in (t for t in flat.topics if t.name in names):
            heard = zip(record.times_ns, record.published, strict=True)
            at = [now for now, published in heard if t.name in published]
            usual = float(np.median(np.diff(at))) if len(at) > 1 else np.inf
            self.most[t.name] = SILENT * usual if t.max_age_ns is None else t.max_age_ns

    def are_published(self, k: int, leaves: Sequence[str]) -> NDArray[np.bool_]:
        """Whether the topic of each driven leaf was published at instant k, (leaves,)."""
        return np.array([name in self.record.published[k] for name in leaves], dtype=np.bool_)

    def hears_all_topics(self, k: int) -> bool:
        """Notes the topics published at instant k; gives whether all topics were heard in time."""
        now = self.record.times_ns[k]
        too_old = [n for n, then in self.last.items() if now - then > self.most[n]]
        self.last.update((n, now) for n in self.names if n in self.record.published[k])
        return not too_old


def _parameter_values(
    reader: RecordReader,
    record: RecordedRun,
    k: int,
    shown: Sequence[tuple[int, tuple[str, ...]]] | None,
) -> tuple[int, ...]:
    if shown is None:
        return reader.true_state(record.topics[k], record.truths[k])[1]
    return reader.parameters_in_topics(shown, record.topics[k])


def _judge_on_estimates(
    reader: RecordReader,
    models: Models,
    record: RecordedRun,
    judgement: Judgement,
    ages: _TopicAges,
    *,
    truths: bool,
) -> None:
    shown = None if truths else parameter_leaves(models.problem)
    leaves = [reader.names[t] for t, _ in driven_leaves(models.problem)]
    box: tuple[Floats, Floats] | None = None
    same: tuple[int, ...] = ()
    u, then, seen_ns, silent = np.zeros(0), 0, 0, False
    for k, now in enumerate(record.times_ns):
        y = reader.driven_values(record.topics[k])
        parameter = _parameter_values(reader, record, k, shown)
        if box is not None and now > then:
            box = _next_box(models.step_of_length(same, now - then), box, u)
        u, then = reader.commands(record.topics[k]), now
        silent, fresh = not ages.hears_all_topics(k) or silent, ages.are_published(k, leaves)
        if parameter == same and not fresh.any():
            continue  # nothing new was published
        apart, gap = now - seen_ns, silent
        seen_ns, silent = now, False
        model = models.matrices(parameter)
        seen = _seen_box(observation_map(models.problem, model), y - model.offset, fresh)
        if box is None or parameter != same:
            box, same = seen, parameter
            continue
        if not np.isfinite([*box, *seen]).all(axis=0).any():
            box = np.maximum(box[0], seen[0]), np.minimum(box[1], seen[1])
            continue  # there is no state of which both are known
        judgement.steps += 1
        judgement.offsets.append(_offset_shares(box, seen))
        judgement.offset_times_s.append(now / 1e9)
        judgement.judged_ns += 0 if gap else apart
        low, high = np.maximum(box[0], seen[0]), np.minimum(box[1], seen[1])
        wrong = [reader.states[i].name for i in np.flatnonzero(low > high)]
        if wrong:
            note_alarm(judgement, record.times_ns[k] / 1e9, wrong)
            low, high = seen
        box = low, high


def _seen_box(sight: ObservationMap, y: Floats, fresh: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """The box of states that the published leaves show, infinite for a state that none shows."""
    x = sight.inverse @ y
    slack = ROUNDING * (np.abs(sight.inverse) @ np.abs(y) + 1.0)
    old = (np.abs(sight.inverse[:, ~fresh]) > UNSEEN).any(axis=1)
    error = np.where(old, np.inf, sight.error) + slack
    return x - error, x + error


def _offset_shares(box: tuple[Floats, Floats], seen: tuple[Floats, Floats]) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):  # of a state that is not known
        apart = (seen[0] + seen[1] - box[0] - box[1]) / (seen[1] - seen[0] + box[1] - box[0])
    return np.where(np.isfinite(apart), apart, 0.0)


def _next_box(step: AffineStep, box: tuple[Floats, Floats], u: Floats) -> tuple[Floats, Floats]:
    half = (box[1] - box[0]) / 2
    with np.errstate(invalid="ignore"):  # of a state that is not known
        mid = np.where(np.isfinite(half), (box[0] + box[1]) / 2, 0.0)
        finite = np.where(np.abs(step.phi) > 0, np.abs(step.phi) * half, 0.0).sum(axis=1)
    centre = step.phi @ mid + step.gamma @ u + step.c
    radius = finite + step.reach
    radius = radius * (1 + ROUNDING) + ROUNDING * np.abs(centre)
    return centre - radius, centre + radius
