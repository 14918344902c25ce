"""Checks that the sensors of a deployed system are as good as the plants of its proof.

Purpose: for every topic that a plant of the proof drove and DM or SC reads, `check_sensors`
compares the error, the age and (for plants that move in steps) the step that the deployed system
declares. For several sensors that publish one by one, `skewed_topics` checks that their values can
count as one state. It bounds by the plant's equations how far each value moves in a time, and finds
the pairs of topics that are too far apart in time for the errors that the proof allows.
Non-goals: which proofs are carried (`proof_transfer.py`).

Why it suffices (docs/deploy.md, "Several sensors"). A read takes topic i as it was at s_i, with
t - s_i in [0, a_i]. Leaf k of it is off by e_k there, moves by V_k a second at most, and E_k is
allowed: it is within E_k of the state of any s with |s - s_i| <= sigma_i, the least (E_k - e_k) /
V_k. Intervals of a line have a point in common if each two of them have, and each two have if |s_i
- s_j| <= max(a_i, a_j) <= sigma_i + sigma_j. Of the s that are in all, s = max(max_i (s_i -
sigma_i), min_i s_i) lies between the oldest and the newest s_i, so it is no older than the oldest
and not in the future, and it does not go back where no s_i does. V_k is taken over all of C, all
commands, disturbances and influences: the state is in C as long as reads were so, and the first
read that is not would be one of a state that has been in C until then.

What is compared, and why it suffices (docs/deploy.md, "What is inherited"): the theorem speaks of a
read as of one state, at most so old, within E. A value that is measured at least every e and
published at most l after it was measured is, at any time t, at most e + l old; its stamp is its
measurement or earlier. The DM enforces `max_age` itself; at a start of SC, up to Lambda after its
release, the stamp is at most e + l + Lambda old, which must not exceed `max_age`. Where the module
declares a drop-out O, a silence may be O longer than that: then SC reads what is at most `max_age`
+ O old, as the proof does. Of a plant that moves in steps (`next`) a read of the proof shows the
step of its instant: the topic has to come once a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import inf, isfinite
from typing import TYPE_CHECKING

from soter.language.elaborate.wellformed import topics_from_outside
from soter.language.model.types import FloatType, leaf_name, leaves, show_ns
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.problem.extract import parameter_cases

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, External, System, Topic
    from soter.verify.problem.problem import Problem


NS = 10**9


@dataclass(frozen=True, eq=False)
class SensedTopic:
    """A topic in the deployed system: at most `age` ns old, with its k-th leaf off by `errors[k]`.

    `allowed[k]` is the error that the proof allows; `errors[k]` is None if the leaf is no float.
    """

    topic: Topic
    age: int
    errors: tuple[float | None, ...]
    allowed: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class TopicSkew:
    """Two topics that may show states `apart` ns from each other; the proof covers `covered` ns."""

    one: Topic
    other: Topic
    apart: int
    covered: int


def skewed_topics(problem: Problem, heard: Sequence[SensedTopic]) -> list[TopicSkew]:
    """The pairs of topics that may be further apart in time than the allowed errors cover.

    Raises `SoterError` R007, X004, X006, as `library_of` does.
    """
    if len(heard) < 2:
        return []
    rates = greatest_rates_of(problem)
    slacks = [_slack_of_topic(problem, h, rates) for h in heard]
    return [
        TopicSkew(heard[i].topic, heard[j].topic, apart, int(covered))
        for i, j, apart, covered in _skewed_pairs([h.age for h in heard], slacks)
    ]


def _skewed_pairs(
    ages: Sequence[int], slacks: Sequence[Fraction | float]
) -> list[tuple[int, int, int, Fraction | float]]:
    """The pairs of sensors i, j whose ages may differ by more than the sum of their slacks.

    Each entry has the numbers i, j, the difference of ages and the sum of slacks, in ns.
    """
    every = combinations(range(len(ages)), 2)
    pairs = [(i, j, max(ages[i], ages[j]), slacks[i] + slacks[j]) for i, j in every]
    return [x for x in pairs if x[2] > x[3]]


def greatest_rates_of(problem: Problem) -> list[float]:
    """The greatest rate of each state of a flow within its range, per s; inf if unknown."""
    assert problem.kind == "flow"
    library, _ = library_of(problem)
    rates = [0.0 for _ in problem.states]
    for parameter in parameter_cases(problem):
        forms = CompiledEnclosures(library, problem, parameter)
        bounds = forms.result_bounds("derivative", forms.whole, len(problem.states))
        for k in range(len(rates)):
            most = inf if bounds is None else float(abs(bounds[k]).max())
            rates[k] = max(rates[k], most) if isfinite(most) else inf
    return rates


def _slack_of_topic(
    problem: Problem, heard: SensedTopic, rates: Sequence[float]
) -> Fraction | float:
    """The time sigma in ns for which a topic stays within the allowed error; inf means for ever.

    It is 0 if a leaf is no float or shows no state, because its rate is then unknown.
    """
    slack: Fraction | float = inf
    index = next(t.index for t in problem.system.topics if t.name == heard.topic.name)
    for k, (_, t) in enumerate(leaves(heard.topic.type)):
        state = problem.state_of_leaf.get((index, k))
        error = heard.errors[k]
        if not isinstance(t, FloatType) or error is None or state is None:
            return Fraction(0)
        rate = rates[state]
        if rate == 0.0:
            continue
        if not isfinite(rate):
            return Fraction(0)
        slack = min(slack, (Fraction(heard.allowed[k]) - Fraction(error)) * NS / Fraction(rate))
    return slack


NO_ERROR = 0.0


class Sensors:
    """The plant topics that DM and SC read in the proof, with the sensors that are deployed."""

    def __init__(self, deployed: System, proof_system: System, problem: Problem) -> None:
        """Finds topics, plants and sensors; `problem` is of a module of `proof_system`."""
        self.deployed = deployed
        self.proof_system = proof_system
        self.module = problem.module.name
        self.external_by_name = {
            deployed.topics[e.topic].name: e for e in topics_from_outside(deployed)
        }
        self.plants: dict[int, Component] = {}
        for c in proof_system.components:
            for topic, _ in c.plant.drives if c.plant is not None else ():
                self.plants[c.scope.topics[topic]] = c
        schedule = problem.times.schedule
        read = {p.topic for p in (*schedule.read_by_dm, *schedule.read_by_sc)}
        self.topics = [t for t in proof_system.topics if t.name in read]
        assert {t.index for t in self.topics} <= self.plants.keys()
        assert len(self.topics) == len(read)

    def allowed_errors_of(self, topic: Topic) -> list[float]:
        """The error that the proof allows for each leaf of a topic."""
        errors = [NO_ERROR for _ in leaves(topic.type)]
        for m in self.plants[topic.index].measured:
            if m.topic == topic.index:
                errors[m.leaf] = m.bound
        return errors


def check_sensors(
    deployed: System, proof_system: System, problem: Problem, diagnostics: Diagnostics
) -> tuple[list[str], list[str]]:
    """Checks the sensors (D019); returns sentences on what they cover, and on assumptions."""
    s = Sensors(deployed, proof_system, problem)
    before = len(diagnostics.items)
    stepped = problem.kind == "map"
    for topic in s.topics:
        e = s.external_by_name[topic.name]
        _check_errors(s, topic, e, diagnostics)
        if stepped:
            _check_steps(s, topic, e, diagnostics)
        else:
            _check_age(s, topic, e, problem, diagnostics)
    if len(diagnostics.items) > before:
        return [], []
    if not stepped:
        for apart in skewed_topics(problem, [_sensed_topic(s, t, problem) for t in s.topics]):
            _report_skew(s, apart, problem, diagnostics)
    if len(diagnostics.items) > before:
        return [], []
    covered = [_cover_in_words(s, topic, problem) for topic in s.topics]
    if len(s.topics) > 1 and not stepped:
        names = ", ".join(t.name for t in s.topics)
        covered.append(f"{names}: measured one by one, within the errors of one state")
    return covered, _sensor_assumptions(s, stepped=stepped)


def _check_errors(s: Sensors, topic: Topic, e: External, diagnostics: Diagnostics) -> None:
    """Reports D019 if the error of a float is undeclared or larger than in the proof."""
    for k, ((path, t), allowed) in enumerate(
        zip(leaves(topic.type), s.allowed_errors_of(topic), strict=True)
    ):
        if not isinstance(t, FloatType):
            continue
        name = leaf_name(topic.name, path)
        declared = e.errors[k]
        if declared is not None and declared <= allowed:
            continue
        text = f"within {declared!r}" if declared is not None else "nothing says how exact it is"
        diagnostics.error(
            "D019",
            f"the error of `{name}` is not covered by the proof in `{s.proof_system.name}`",
            e.span,
            text,
            notes=(f"there its plant is `measured ... within {allowed!r}`",),
            helps=(f"write `measured {name} within {allowed!r}` or less, if that is true",),
        )


def _check_age(
    s: Sensors, topic: Topic, e: External, problem: Problem, diagnostics: Diagnostics
) -> None:
    """Reports D019 if a topic is so rare or late that SC may read a value that is too old."""
    if e.every_ns is None:
        diagnostics.error(
            "D019",
            f"nothing says how often `{topic.name}` comes",
            e.span,
            notes=("SC answers reads that are at most so old",),
            helps=(f"write `external topic {topic.name} every d`",),
        )
        return
    oldest, allowed = _oldest_read(e, problem), _greatest_proved_age(topic, problem)
    if oldest <= allowed:
        return
    starts = show_ns(problem.times.schedule.latest_start_of_sc)
    delay = show_ns(e.delay_ns or 0)
    word = "max_age" if allowed == topic.max_age_ns else "age"
    notes = [
        f"every {show_ns(e.every_ns)}, {delay} on its way, and SC starts up to {starts} late",
        f"the proof in `{s.proof_system.name}` is about {show_ns(allowed)} (`{word}`)",
    ]
    if problem.times.schedule.dropout:
        notes.append("`dropout` is for silences, not for what is always so")
    diagnostics.error(
        "D019",
        f"`{topic.name}` may be {show_ns(oldest)} old when SC reads it",
        e.span,
        notes=tuple(notes),
        helps=(f"let it come more often, or prove with a larger `{word}`",),
    )


def _greatest_proved_age(topic: Topic, problem: Problem) -> int:
    """The greatest age in ns at which SC reads a topic in the proof, or else its `max_age`."""
    read = (p.max_age for p in problem.times.schedule.read_by_sc if p.topic == topic.name)
    return next(read, topic.max_age_ns) or 0


def _oldest_read(e: External, problem: Problem) -> int:
    assert e.every_ns is not None
    return e.every_ns + (e.delay_ns or 0) + problem.times.schedule.latest_start_of_sc


def _check_steps(s: Sensors, topic: Topic, e: External, diagnostics: Diagnostics) -> None:
    """Reports D019 if a topic does not come once in each step of its plant without delay."""
    plant = s.plants[topic.index]
    if e.every_ns == plant.period_ns and not e.delay_ns:
        return
    period = "nothing" if e.every_ns is None else f"every {show_ns(e.every_ns)}"
    text = f"{period}, delayed {show_ns(e.delay_ns)}" if e.delay_ns else period
    diagnostics.error(
        "D019",
        f"`{topic.name}` shows a plant that moves in steps, and does not come with each of them",
        e.span,
        text,
        notes=(
            f"plant `{plant.name}` moves every {show_ns(plant.period_ns)}; reads show that step",
        ),
        helps=(
            f"write `external topic {topic.name} every {show_ns(plant.period_ns)}`, if it is so",
        ),
    )


def _sensed_topic(s: Sensors, topic: Topic, problem: Problem) -> SensedTopic:
    e = s.external_by_name[topic.name]
    assert e.every_ns is not None
    age = e.every_ns + (e.delay_ns or 0) + problem.times.schedule.dropout
    return SensedTopic(topic, age, e.errors, tuple(s.allowed_errors_of(topic)))


def _report_skew(s: Sensors, pair: TopicSkew, problem: Problem, diagnostics: Diagnostics) -> None:
    one, other = pair.one, pair.other
    silent = problem.times.schedule.dropout
    beside = f", a silence of {show_ns(silent)} included" if silent else ""
    diagnostics.error(
        "D019",
        f"`{one.name}` and `{other.name}` may show states {show_ns(pair.apart)} apart",
        s.external_by_name[other.name].span,
        notes=(
            f"they come one by one{beside}, and the proof is about reads that show one instant",
            f"what is left of the errors covers {show_ns(pair.covered)}, as fast as it moves",
            "a leaf that is no state of the plant, as it is, covers nothing",
        ),
        helps=(
            "publish them as one topic, a record that is measured at one instant",
            "or prove with larger errors (`measured ... within`), or let them come more often",
        ),
    )


def _cover_in_words(s: Sensors, topic: Topic, problem: Problem) -> str:
    e = s.external_by_name[topic.name]
    exact = [
        f"{'.'.join(path) or topic.name} within {declared!r} of {allowed!r}"
        for (path, t), declared, allowed in zip(
            leaves(topic.type), e.errors, s.allowed_errors_of(topic), strict=True
        )
        if isinstance(t, FloatType)
    ]
    if problem.kind == "map":
        most = topic.max_age_ns or 0
        assert e.every_ns is not None
        assert most < e.every_ns, "R011: the DM finds a step that is missing"
        age = f"with each step of {show_ns(e.every_ns)}, or stale ({show_ns(most)})"
    else:
        most = _greatest_proved_age(topic, problem)
        age = f"at most {show_ns(_oldest_read(e, problem))} old of {show_ns(most)}"
        if problem.times.schedule.dropout:
            age += f", and silences {show_ns(problem.times.schedule.dropout)} longer"
    return f"{topic.name}: {', '.join([age, *exact])}"


def _sensor_assumptions(s: Sensors, *, stepped: bool) -> list[str]:
    assumptions = [f"what moves starts where the plants of {s.proof_system.name} do"] * bool(
        s.topics
    )
    for topic in s.topics:
        assumptions.append(
            f"{topic.name} is published before the first step (SOTER_UNHEARD tells), and shows "
            "where that finds it"
        )
        assumptions += [
            f"{leaf_name(topic.name, path)} is exactly what the plant would say"
            for path, t in leaves(topic.type)
            if not isinstance(t, FloatType)
        ]
    if stepped:
        named = ", ".join(dict.fromkeys(s.plants[t.index].name for t in s.topics))
        assumptions += [
            f"what {named} models moves in steps, each after an instant, with what was read then",
            "what is published before an instant shows that step: loop and steps go by turns",
            "between two steps nothing is claimed",
        ]
    return assumptions
