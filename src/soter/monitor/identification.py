"""Finds values of parameters that explain recorded episodes, and how many new ones will not be.

Purpose: `identified_parameters` fits parameters of a program to one half of the episodes, and
scales bounds among them until the model monitor explains the other half, too: an episode is
explained where `judge_run` (`model_membership.py`) raises no alarm. Model parameters minimise
the squares of the monitor's offsets (SciPy); bounds are shrunk, one after the other, to the least
that explain the training half; then one factor scales them all, the least with which every held-out
episode is explained. That is split conformal prediction (Papadopoulos et al., 2002) whose score is
the least factor of an episode: of exchangeable ones a new one needs more than N held-out ones did
with a probability of at most 1/(N+1).
Non-goals: reading logs (`api/identifying.py`); showing that a model is true, or episodes alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import mistake
from soter.monitor.linear_model import linear_model
from soter.monitor.model_membership import Models, RecordReader, judge_run
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.core.layout import Floats
    from soter.language.model.system import Module, System
    from soter.monitor.model_membership import Judgement
    from soter.simulate.run_log import RecordedRun
    from soter.verify.problem.problem import Problem

    Posed = list[tuple[System, Module, Problem]]
    """The modules that are judged, and their problems, at some values of parameters."""

FLOOR, CEILING = 2.0**-20, 2.0**10
"""The least and the greatest factor of a bound that is tried."""
TOLERANCE = 1e-3
"""The relative error that a found factor may have: it may be that much above the least one."""
ROUNDS = 2
"""Offsets are shares of bounds: with better bounds the model is fitted again."""
WEAK = 1e-6
"""Offsets do not show a direction of parameters that is weaker than this share of the strongest."""
STILL = 1e-9
"""A command that moves by no more than this share of its set was not excited."""


@dataclass(frozen=True)
class Episode:
    """A recorded run that counts as one draw; `name` says from which log, and from which time."""

    name: str
    record: RecordedRun


@dataclass(frozen=True)
class OpenParameter:
    """A parameter to fit, its start and range; `bound`: a greater value only widens intervals."""

    name: str
    start: float
    low: float
    high: float
    bound: bool = False


@dataclass(frozen=True)
class EpisodeAlarm:
    """The first alarm in an episode that no values explain: its time and its states."""

    module: str
    episode: str
    at_s: float
    states: tuple[str, ...]


@dataclass(frozen=True)
class Identification:
    """The result of a fit: `values` of the parameters that the episodes determine.

    `kept`: the other open parameters. `held_out`: the number N of held-out episodes. `factor`: by
    how much the bounds of the training half had to grow for these; 1 or less if they did not.
    `excitation`: the share of its set that each command used; 0 or 1 if the set is endless.
    `alarm`: None if all steps are explained. `ranges`: the limits of each open parameter.
    """

    values: Mapping[str, float]
    declared: Mapping[str, float]
    bounds: tuple[str, ...]
    kept: tuple[str, ...]
    episodes: int
    held_out: int
    factor: float | None
    steps: int
    judged_share: float
    excitation: Mapping[str, float]
    alarm: EpisodeAlarm | None = None
    alarms: int = 0
    cut_s: float | None = None
    logs: Mapping[str, str] = field(default_factory=dict)
    program_sha256: str = ""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """1/(N+1): the greatest probability that a new episode, drawn alike, is not explained."""
        return 1 / (self.held_out + 1)

    @property
    def never_excited(self) -> tuple[str, ...]:
        """The commands that were constant in every episode."""
        return tuple(n for n, share in self.excitation.items() if share <= STILL)


def identified_parameters(
    pose: Callable[[Mapping[str, float]], Posed],
    parameters: Sequence[OpenParameter],
    episodes: Sequence[Episode],
    *,
    estimates: bool,
    truths: bool,
) -> Identification:
    """Fits `parameters` (`open_parameters`) to the episodes, and holds every second one out.

    `pose` gives the modules for parameter values; `estimates`, `truths`: see `judge_run`. Raises
    SoterError U001 if the monitor judges no step of an episode, D007 without SciPy.
    """
    start = {p.name: p.start for p in parameters}
    fit = _Fit(pose, parameters, estimates=estimates, truths=truths)
    training, held_out = episodes[::2], episodes[1::2]
    values, kept = start, list[str]()
    asked: list[str] | None = None
    for k in range(1, ROUNDS + 1):
        phase(f"round {k} of {ROUNDS}: the model by least squares, on {len(training)} episodes")
        values, kept = fit.fitted_model(values, training)
        phase(f"round {k} of {ROUNDS}: the least bounds, on {len(training)} episodes")
        asked = fit.shrink_bounds(values, training)
    phase(f"{len(held_out)} held-out episodes")
    factor = None if asked is None else fit.least_factor(values, asked, held_out)
    values |= (
        fit.tried if factor is None else fit.scaled_bounds(values, asked or (), max(1.0, factor))
    )
    judged = [(e, j) for e in episodes for j in fit.judgements(values, [e])]
    wrong = [(e, j) for e, j in judged if j.alarms]
    kept += [n for n in fit.bounds if n not in (asked or ())]
    return Identification(
        values={n: v for n, v in values.items() if n not in kept},
        declared=start,
        bounds=tuple(fit.bounds),
        kept=tuple(n for n in start if n in kept),
        episodes=len(episodes),
        held_out=len(held_out),
        factor=factor,
        steps=sum(j.steps for _, j in judged),
        judged_share=min(j.judged_share for _, j in judged),
        excitation=_excitation_by_command(pose(start), episodes),
        alarm=_first_alarm(*wrong[0]) if wrong else None,
        alarms=len({id(e) for e, _ in wrong}),
        ranges={p.name: (p.low, p.high) for p in parameters},
    )


def open_parameters(
    pose: Callable[[Mapping[str, float]], Posed], declared: Sequence[OpenParameter], *, named: bool
) -> list[OpenParameter]:
    """The parameters that plants, bounds or errors depend on, with `bound` set for bounds.

    `named`: each was asked for, so one that nothing depends on is an error. SoterError U001.
    """
    start = {p.name: p.start for p in declared}
    found = [(p, _classified_parameter(pose, p, start)) for p in declared]
    lost = [p.name for p, kind in found if kind is None]
    if len(lost) == len(found) or (named and lost):
        parameter = f"on {lost[0]}" if named and lost else "on a parameter of the main file"
        text = f"no plant of a proof, no bound and no error depends {parameter}"
        raise mistake("U001", text, "open what may be fitted: `param WIND: float = 0.1 in [0, 1];`")
    return [kind for _, kind in found if kind is not None]


def _first_alarm(episode: Episode, j: Judgement) -> EpisodeAlarm:
    assert j.first_alarm_s is not None
    return EpisodeAlarm(j.module, episode.name, j.first_alarm_s, tuple(j.alarm_states))


def _classified_parameter(
    pose: Callable[[Mapping[str, float]], Posed], p: OpenParameter, start: Mapping[str, float]
) -> OpenParameter | None:
    """The parameter, marked if it is a bound; None if no plant, bound or error depends on it."""
    wider = min(2 * p.start, p.high) if p.start > 0 else p.high
    narrower = ((p.low + p.start) / 2, p.start / 2 or 1.0)
    other = next(v for v in (wider, *narrower) if v != p.start and np.isfinite(v))
    (plants, sets), (others, wide) = (
        _plant_and_set_numbers(pose({**start, p.name: v})) for v in (p.start, other)
    )
    in_plants, in_sets = not np.array_equal(plants, others), not np.array_equal(sets, wide)
    if not in_sets:
        return p if in_plants else None
    less, more = (sets, wide) if other > p.start else (wide, sets)
    widens = less.shape != more.shape or (less <= more).all()  # [0, 0] counts as no interval
    if in_plants or not widens:
        text = f"`{p.name}` is no bound that, as it grows, widens intervals and does nothing else"
        raise mistake("U001", text, "write a parameter of its own: `disturbance w in [-W, W];`")
    if p.start == 0:
        text = f"the bound `{p.name}` is 0, which no factor makes greater"
        raise mistake("U001", text, "declare the value to begin with, such as 0.1")
    return replace(p, bound=True)


def _plant_and_set_numbers(posed: Posed) -> tuple[Floats, Floats]:
    """All entries of the plants' matrices, (entries,), and all ends of sets as (high, -low)."""
    plants, sets = [np.zeros(0)], [np.zeros(0)]
    for _, _, problem in posed:
        m = linear_model(problem, tuple(p.values[0] for p in problem.parameters))
        plants += [part.ravel() for part in (m.a, m.b, m.c, m.w, m.drives, m.offset)]
        ranges = [*problem.disturbances, *problem.errors]
        sets += [np.array([(r.high, -r.low) for r in ranges]).ravel()]
    return np.concatenate(plants), np.concatenate(sets)


def _excitation_by_command(posed: Posed, episodes: Sequence[Episode]) -> dict[str, float]:
    found = {}
    for flat, module, problem in posed:
        reader = RecordReader(flat, module, problem)
        rows = np.array([reader.commands(t) for e in episodes for t in e.record.topics])
        for leaf, column, r in zip(reader.controls, rows.T, problem.controls, strict=True):
            moved = float(np.ptp(column))
            found[leaf.name] = moved / (r.high - r.low) if r.high - r.low < inf else moved and 1.0
    return found


class _Fit:
    """Asks the monitor how well values of parameters explain episodes."""

    def __init__(
        self,
        pose: Callable[[Mapping[str, float]], Posed],
        parameters: Sequence[OpenParameter],
        *,
        estimates: bool,
        truths: bool,
    ) -> None:
        self.pose, self.known = pose, {p.name: p for p in parameters}
        self.bounds = [p.name for p in parameters if p.bound]
        self._estimates, self._truths = estimates, truths
        self.tried: dict[str, float] = {}
        """The bounds that were last tried without success."""

    def judgements(
        self, values: Mapping[str, float], episodes: Sequence[Episode]
    ) -> Iterator[Judgement]:
        """The monitor's judgements of episodes; raises U001 if it judges no step of an episode."""
        for flat, module, problem in self.pose(values):
            models, how = Models(problem), {"estimates": self._estimates, "truths": self._truths}
            for e in episodes:
                j = judge_run(flat, module, problem, e.record, models=models, **how)
                if not j.steps:
                    text = f"nothing of `{module.name}` is judged in {e.name}"
                    raise mistake("U001", text, "leave it out, or take longer episodes")
                yield j

    def fitted_model(
        self, start: Mapping[str, float], training: Sequence[Episode], without: Sequence[str] = ()
    ) -> tuple[dict[str, float], list[str]]:
        """The least-squares parameters of the model, and those that offsets do not determine."""
        free = [p for n, p in self.known.items() if not p.bound and n not in without]
        start = {**start, **{n: self.known[n].start for n in without}}
        if not free:
            return start, list(without)

        low, first, high = np.array([(p.low, p.start, p.high) for p in free]).T
        units = np.where(first == 0, 1.0, np.abs(first))
        # z is 1 at the lower end, in such units: a share of a value near 0 would be no step.
        below = np.where(np.isfinite(low), low, first) - units

        def values_at(z: Floats) -> dict[str, float]:
            values = np.clip(below + z * units, low, high)
            return {**start, **{p.name: float(v) for p, v in zip(free, values, strict=True)}}

        def offsets(z: Floats) -> Floats:
            return np.concatenate(
                [np.ravel(j.offsets) for j in self.judgements(values_at(z), training)]
            )

        low_z, first_z, high_z = ((x - below) / units for x in (low, first, high))
        how: dict[str, Any] = {"bounds": (low_z, high_z), "x_scale": "jac", "diff_step": 1e-5}
        found = _scipy_least_squares()(offsets, first_z, **how)
        sizes = np.linalg.norm(found.jac, axis=0)
        unit = found.jac / np.where(sizes > 0, sizes, 1.0)
        strengths, directions = np.linalg.eigh(unit.T @ unit)
        if strengths[0] <= WEAK**2:
            least = free[int(np.argmax(np.abs(directions[:, 0])))].name
            return self.fitted_model(start, training, (*without, least))
        return values_at(found.x), list(without)

    def scaled_bounds(
        self, values: Mapping[str, float], names: Sequence[str], factor: float
    ) -> dict[str, float]:
        """The bounds in `names`, multiplied by `factor` and cut to their ranges."""
        known = self.known
        return {n: min(max(values[n] * factor, known[n].low), known[n].high) for n in names}

    def least_factor(
        self, values: Mapping[str, float], names: Sequence[str], episodes: Sequence[Episode]
    ) -> float | None:
        """The least factor of these bounds with which the monitor explains all episodes.

        `FLOOR` if the least permitted bounds explain them, or if `names` is empty; None if even the
        greatest bounds do not.
        """

        def explains_all(factor: float) -> bool:
            bounds = self.scaled_bounds(values, names, factor)
            if any(j.alarms for j in self.judgements({**values, **bounds}, episodes)):
                self.tried = bounds
                return False
            return True

        low, high = FLOOR, 1.0
        while not explains_all(high):
            if high >= CEILING or not names:
                return None
            low, high = high, 2 * high
        if low == FLOOR and (not names or explains_all(FLOOR)):
            return FLOOR
        while high > low * (1 + TOLERANCE):
            middle = sqrt(low * high)
            low, high = (low, middle) if explains_all(middle) else (middle, high)
        return high

    def shrink_bounds(
        self, values: dict[str, float], training: Sequence[Episode]
    ) -> list[str] | None:
        """Writes the least bounds that explain `training` into `values`; gives the needed bounds.

        All bounds are first scaled by one factor, then one after another, in declared order. An
        unneeded bound stays as declared. None if no bounds explain the episodes.
        """
        factor = self.least_factor(values, self.bounds, training)
        if factor is None:
            return None
        needed = list[str]()
        values |= self.scaled_bounds(values, self.bounds, factor if factor > FLOOR else 1.0)
        for name in self.bounds:
            alone = self.least_factor(values, [name], training)
            assert alone is not None
            back = {name: self.known[name].start}
            values |= back if alone == FLOOR else self.scaled_bounds(values, [name], alone)
            needed += [name] * (alone > FLOOR)
        return needed


def _scipy_least_squares() -> Callable[..., Any]:
    """SciPy's `least_squares`; raises SoterError D007 where SciPy is not installed."""
    try:
        from scipy import optimize  # noqa: PLC0415 - an extra, slow to import
    except ModuleNotFoundError:
        text = "model parameters are fitted with the package `scipy`, which is not installed"
        raise mistake("D007", text, f"install it: {pip_command('identify')}") from None
    solve: Callable[..., Any] = optimize.least_squares
    return solve
