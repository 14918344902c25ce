"""Reports times that a proof does not cover, with the codes R011, R012, R015, R017 and R018.

Purpose: `check_times` checks every condition under which the theorem covers a schedule.
`times_without_delays` reduces the times of plants that move in steps to periods and phases.
Non-goals: the figures themselves (`schedule.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns
from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model.system import Component
    from soter.language.model.typed import ModuleSymbol
    from soter.verify.problem.cause_effect_chains import CauseEffectChain, CauseEffectChains
    from soter.verify.problem.problem import ProblemKind, Times
    from soter.verify.problem.verification_system import VerificationSystem


PERIODS_TRIED = 8
"""How many periods of SC are tried where its own is too short."""


def check_times(
    place: VerificationSystem,
    kind: ProblemKind,
    times: Times,
    chains: CauseEffectChains,
    diagnostics: Diagnostics,
) -> None:
    """Reports each time that the theorem does not cover."""
    if kind == "map":
        _check_map_times(place, times, chains, diagnostics)
        if diagnostics.has_errors:
            return
    _check_known_nodes(place, chains, diagnostics)
    _check_read_ages(times, chains, diagnostics)
    for chain in dict.fromkeys([*chains.by_dm, *chains.by_sc]):
        _check_first_results(chain, diagnostics)
    for node, at in _releases_of_nodes(chains):
        _check_node_fits(place, node, at, diagnostics)
    _check_dm_fits(place, times, diagnostics)
    _check_skipped_outputs(place, times, chains, diagnostics)
    if kind == "map" or any(d.code == "R018" for d in diagnostics.items):
        return
    _check_command_delay(place, times, diagnostics)


def _check_command_delay(place: VerificationSystem, times: Times, diagnostics: Diagnostics) -> None:
    """Reports R015 if SC is not done before its next step, or acts later than proofs cover."""
    schedule, sc = times.schedule, place.sc
    span = place.module.symbol.verify.span or place.module.symbol.span
    symbol = place.module.symbol
    why = why_late_commands_uncovered(symbol, schedule)
    enough = _advice_on_period(schedule, in_order=bool(why))
    if schedule.latest_output > schedule.sc.period:
        diagnostics.error(
            "R015",
            f"SC may take {show_ns(schedule.latest_output)} from its release, longer than "
            "its period",
            span,
            also=((sc.span, f"steps every {show_ns(sc.period_ns)}"),),
            notes=(
                " + ".join(f"{show_ns(ns)} {name}" for ns, name in _parts_before_output(times)),
                "no release is skipped, and outputs come in order",
            ),
            helps=(f"shorter times{enough}",),
        )
        return
    if why and not schedule.are_windows_short:
        excess = show_ns(times.jitter_sc - times.delta_sc // 2)
        diagnostics.error(
            "R015",
            f"SC may act {show_ns(times.jitter_sc)} late, more than half of its period",
            span,
            also=((sc.span, f"steps every {show_ns(times.delta_sc)}"),),
            notes=(_jitter_in_words(times), f"commands that act so late are not proved {why}"),
            helps=(
                *_advice_on_least_delay(times),
                f"these times together {excess} shorter{enough}",
            ),
        )


def why_late_commands_uncovered(symbol: ModuleSymbol, schedule: Schedule) -> str:
    """Why no proof covers commands that act over half a period late; "" if a proof covers them."""
    verify = symbol.verify
    wrong = {
        "with a node between SC and the plant": any(o.nodes for o in schedule.outputs),
        "of an abstraction": bool(verify.abstracts or verify.views),
        "by tubes (`rest`)": symbol.rest is not None,
        "with a `failsafe`": bool(symbol.failsafe),
        "with a `shield`": symbol.shield is not None,
    }
    return next((why for why, is_so in wrong.items() if is_so), "")


def _jitter_in_words(times: Times) -> str:
    """The sum j and its summands in words (docs/proof.md, The model of time)."""
    parts = [*_parts_before_output(times), (times.acts, "`acts within`")]
    rest = times.jitter_sc - sum(ns for ns, _ in parts)
    parts_in_words = [f"{show_ns(ns)} {name}" for ns, name in parts if ns]
    if rest > 0:
        parts_in_words.append(f"{show_ns(rest)} on the way through nodes behind SC")
    elif rest < 0:
        parts_in_words.append(f"less the {show_ns(-rest)} that a command takes in any case")
    return f"{show_ns(times.jitter_sc)} = {' + '.join(parts_in_words).replace('+ less', '- less')}"


def _parts_before_output(times: Times) -> list[tuple[int, str]]:
    """The parts (ns, name) of the time from a release of SC to its publication."""
    sc, waits = times.schedule.sc, times.schedule.latest_start_of_sc
    late = "`late sc`" if waits == sc.late else "waiting for the DM's verdict"
    return [(waits, late), (sc.response, "`response sc`")]


def _advice_on_least_delay(times: Times) -> tuple[str, ...]:
    """Advice to declare the least time until a command acts; empty if this would not be enough."""
    without = times.jitter_sc - (times.acts - times.acts_least)
    if 2 * without > times.delta_sc:
        return ()
    most = show_ns(times.acts).replace(" ", "")
    enough = f"`acts within A to {most}` where each command takes at least A until it acts"
    return (f"{enough}: only what is more than A is late",)


def _advice_on_period(schedule: Schedule, *, in_order: bool) -> str:
    """A clause that advises a period with which SC is in time; "" if no period is found.

    Periods are tried one by one, as they change how long SC waits. The clause also names the
    module's period if P1a needs a longer one. With the advised period no read may exceed `max_age`.
    """
    slower = schedule
    for _ in range(PERIODS_TRIED):
        period = max(slower.latest_output, 2 * slower.jitter * in_order)
        if period <= slower.sc.period:
            break
        dm = replace(schedule.dm, period=max(schedule.dm.period, period))
        slower = replace(schedule, dm=dm, sc=replace(schedule.sc, period=period))
    else:
        return ""
    if any(slower.stamp_age_sc(p) > p.max_age for p in slower.read_by_sc if p.max_age is not None):
        return ""
    longest = show_ns(slower.sc.period)
    if slower.dm.period == schedule.dm.period:
        return f", or a period of SC of {longest}"
    return f", or a period of {longest} of both SC and the module (P1a: SC may not be the slower)"


def _check_known_nodes(
    place: VerificationSystem, chains: CauseEffectChains, diagnostics: Diagnostics
) -> None:
    """Reports R017 if a time is declared for a node that is on no path of the proof."""
    verify = place.module.symbol.verify
    inner = [n for w in chains.ways for n in (*w.inner, *w.in_step)]
    stations = [n.name.removeprefix(place.home_prefix) for n in (*chains.nodes, *chains.behind)]
    for name, expr in {**verify.late_of, **verify.response_of}.items():
        if name in stations:
            continue
        named = any(n.name.removeprefix(place.home_prefix) == name for n in inner)
        stations_text = ", ".join(f"`{n}`" for n in stations) or "none"
        diagnostics.error(
            "R017",
            f"`{name}` is no node whose time counts here",
            expr.span,
            "its time is said here",
            notes=(
                "it has sensors of its own and belongs to the plants of the proof"
                if named
                else f"nodes between sensors, module and plants: {stations_text}",
            ),
            helps=("of the module's own SC and DM it is `sc` and `dm`",),
        )


def _check_read_ages(times: Times, chains: CauseEffectChains, diagnostics: Diagnostics) -> None:
    """Reports R011 if SC may read a topic that is older than its `max_age` or `age`."""
    topics_told = set()
    for chain in chains.by_sc:
        oldest = times.schedule.stamp_age_sc(chain.path)
        limit, publisher = chain.path.max_age, (*(n for n in (chain.sensor, *chain.nodes) if n),)
        if limit is None or oldest <= limit or chain.topic.index in topics_told:
            continue
        topics_told.add(chain.topic.index)
        word = "max_age" if limit == chain.topic.max_age_ns else "age"
        also: tuple[tuple[Span, str], ...] = ()
        if publisher:
            last = publisher[-1]
            also = ((last.span, f"publishes every {show_ns(last.period_ns)}"),)
        diagnostics.error(
            "R011",
            f"SC may read `{chain.topic.name}` when it is {show_ns(oldest)} old, "
            f"longer than its `{word}` of {show_ns(limit)}",
            chain.topic.symbol.span,
            also=also,
            notes=("no runtime enforces the age of what SC reads: it must hold by itself",),
            helps=(f"a longer `{word}`, or somebody who publishes more often",),
        )


def _check_first_results(chain: CauseEffectChain, diagnostics: Diagnostics) -> None:
    """Reports R017 if a node may publish a result of a default with a fresh stamp."""
    early = chain.path.early_node
    if early is None:
        return
    node = chain.stations[early]
    before = chain.sensor if early == 0 else chain.stations[early - 1]
    who = f"`{before.name}`" if before is not None else "an input"
    diagnostics.error(
        "R017",
        f"`{node.name}` may publish `{chain.topic.name}` before it has read {who}",
        node.span,
        also=() if before is None else ((before.span, "may come later"),),
        notes=("what it publishes is then made of a default, and looks as fresh as any other",),
        helps=("give it a phase, so that its first step comes later",),
    )


def _releases_of_nodes(chains: CauseEffectChains) -> list[tuple[Component, Releases]]:
    releases_by_node: dict[Component, Releases] = {}
    for chain in (*chains.by_dm, *chains.by_sc):
        releases_by_node.update(zip(chain.stations, chain.path.nodes, strict=True))
    releases_by_node.update({n: r for n, r in chains.releases.items() if n in chains.behind})
    return list(releases_by_node.items())


def _check_node_fits(
    place: VerificationSystem, node: Component, at: Releases, diagnostics: Diagnostics
) -> None:
    if at.latest <= at.period:
        return
    diagnostics.error(
        "R015",
        f"`{node.name}` may take {show_ns(at.latest)} from its release, longer than its period",
        node.span,
        also=((place.module.symbol.verify.span or place.module.symbol.span, "declared here"),),
        notes=(_step_time_in_words(at), "no release is skipped, and outputs come in order"),
        helps=(f"a period of {show_ns(at.latest)} or more, or shorter times",),
    )


def _step_time_in_words(at: Releases) -> str:
    """The longest time of a step of a node or of the DM, in words, as a sum."""
    parts = f"{show_ns(at.late)} `late` + {show_ns(at.response)} `response`"
    return f"{show_ns(at.latest)} = {parts}, out of a period of {show_ns(at.period)}"


def _check_dm_fits(place: VerificationSystem, times: Times, diagnostics: Diagnostics) -> None:
    dm = times.schedule.dm
    if dm.latest <= dm.period:
        return
    diagnostics.error(
        "R015",
        f"the DM may take {show_ns(dm.latest)} from its release, longer than its period",
        place.module.symbol.verify.span or place.module.symbol.span,
        notes=(_step_time_in_words(dm), "no release is skipped, and verdicts come in order"),
        helps=(f"a period of the module of {show_ns(dm.latest)} or more, or shorter times",),
    )


def _check_skipped_outputs(
    place: VerificationSystem, times: Times, chains: CauseEffectChains, diagnostics: Diagnostics
) -> None:
    """Reports R018 if a node behind SC may skip an output; the output before then acts too long."""
    schedule = times.schedule
    skips: list[Component] = []
    outputs = {o.nodes: o for o in schedule.outputs}
    stations = dict(_releases_of_nodes(chains))
    for way in chains.ways:
        at = outputs[tuple(stations[n] for n in way.counted)].skipping_node(
            schedule.sc, schedule.latest_output
        )
        skips += [] if at is None else [way.counted[at]]
        skips += [n for n in way.inner if max(n.period_ns, _execution_time(n)) > schedule.sc.period]
    for node in dict.fromkeys(skips):
        diagnostics.error(
            "R018",
            f"`{node.name}` may miss a command of SC",
            node.span,
            f"steps every {show_ns(max(node.period_ns, _execution_time(node)))}",
            also=((place.sc.span, f"publishes every {show_ns(place.sc.period_ns)}"),),
            notes=("the proof is about every command of SC acting for a period",),
            helps=("let it step at least as often as SC, its lateness included",),
        )


def _execution_time(node: Component) -> int:
    """The declared longest execution time of a node's step, in ns; 0 if none is declared."""
    return 0 if node.takes_ns is None else node.takes_ns[1]


def _check_map_times(
    place: VerificationSystem, times: Times, chains: CauseEffectChains, diagnostics: Diagnostics
) -> None:
    """Reports times that do not fit a map, which is defined at multiples of its period."""
    step = place.plants[0].period_ns
    symbol = place.module.symbol
    _check_whole_steps(place, times, step, diagnostics)
    for chain in dict.fromkeys([*chains.by_dm, *chains.by_sc] if place.abstract else []):
        _check_every_step(place, chain, step, diagnostics)
    acts = times.schedule.latest_output + times.acts
    paths = (*times.schedule.read_by_dm, *times.schedule.read_by_sc)
    often = min([step, *(p.sensor.period for p in paths)])
    stamps = [p.max_age or 0 for p in paths]
    late = {
        "`max_age`": max(stamps, default=0),
        "the sum of `late`, `response` and `acts`": acts,
        "`dropout`": often if times.schedule.dropout else 0,
    }
    for delay, ns in late.items():
        if ns >= often:
            diagnostics.error(
                "R012",
                f"{delay} of {show_ns(ns)} is no less than the plant's period, {show_ns(often)}",
                symbol.span,
                notes=("with `next`, what is read and what acts must be of the same instant",),
                helps=(f"make it shorter than {show_ns(often)}",),
            )
    for node in [*chains.nodes, *chains.behind]:
        diagnostics.error(
            "R012",
            f"`{node.name}` stands between module `{symbol.name}` and a plant that moves in steps",
            node.span,
            notes=("with `next`, what is read and what acts must be of the same instant",),
            helps=("let SC read the plant's own topic, and the plant SC's",),
        )


def _check_whole_steps(
    place: VerificationSystem, times: Times, step: int, diagnostics: Diagnostics
) -> None:
    """Reports R012 for periods and phases that are no multiples of the map's period."""
    symbol = place.module.symbol
    wrong = {
        "the plants": [c.period_ns for c in place.plants if c.period_ns != step],
        "the decision module": [times.delta_dm] if times.delta_dm % step else [],
        "the safe controller": [times.delta_sc] if times.delta_sc % step else [],
        "the phases": [p for p in (times.phase_sc, times.phase_dm) if p % step],
    }
    for who, periods in wrong.items():
        if periods:
            diagnostics.error(
                "R012",
                f"{who} of module `{symbol.name}` cannot run every "
                f"{show_ns(periods[0])} beside a plant that moves every {show_ns(step)}",
                symbol.span,
                notes=("a plant with `next` has no state between the multiples of its period",),
                helps=("use multiples of the plant's period",),
            )


def _check_every_step(
    place: VerificationSystem, chain: CauseEffectChain, step: int, diagnostics: Diagnostics
) -> None:
    """Reports R012 if a sensor does not publish at every step of the abstraction."""
    at = chain.path.sensor
    if not (at.phase or step % at.period):
        return
    diagnostics.error(
        "R012",
        f"`{chain.path.publisher}` publishes every {show_ns(at.period)}, and not whenever the "
        f"plant of the proof steps, every {show_ns(step)}",
        place.module.symbol.span,
        also=() if chain.sensor is None else ((chain.sensor.span, "stands behind it"),),
        notes=("with `next`, what is read and what acts must be of the same instant",),
        helps=(f"a period of which {show_ns(step)} is a multiple",),
    )


def times_without_delays(times: Times) -> Times:
    """The times of a map: periods and phases alone, as it is read and moved at one instant."""
    schedule = times.schedule
    return replace(
        times,
        schedule=Schedule(
            Releases(schedule.dm.period, schedule.dm.phase),
            Releases(schedule.sc.period, schedule.sc.phase),
            _paths_within_one_instant(schedule.read_by_dm),
            _paths_within_one_instant(schedule.read_by_sc),
            (ActuationPath(),),
        ),
    )


def _paths_within_one_instant(paths: tuple[SensorPath, ...]) -> tuple[SensorPath, ...]:
    return tuple(replace(p, nodes=(), max_age=0) for p in paths)
