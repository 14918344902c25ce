"""Checks P1c of a deployed module: how long a switch to SC takes with declared execution times.

Purpose: `switch_latency_of` computes H* from the latest starts and ends of the thread's steps, and
compares it with the H of the proof.
Non-goals: whether the proof's own times hold (`problem_times.py`), any set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.model.types import show_ns
from soter.verify.problem.cause_effect_chains import CauseEffectChains, actuation_paths
from soter.verify.problem.problem import Times
from soter.verify.problem.problem_times import (
    AssumedTimes,
    assumed_times_of,
    deployed_times,
    summands_of_h_star,
    times_of,
)
from soter.verify.problem.supported_constructs import check_supported
from soter.verify.problem.time_checks import times_without_delays
from soter.verify.problem.verification_system import system_with_mode_topics, verification_system_of

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.language.model.system import Module, System
    from soter.verify.problem.cause_effect_chains import CauseEffectChain
    from soter.verify.problem.problem_times import DeployedTimes
    from soter.verify.problem.schedule import Releases, Schedule


HOLDS, FAILS, UNKNOWN = "holds", "fails", "undecided"
CODES_OF_DEPLOYED_TIMES = ("R034", "R033")
"""The codes of diagnostics about the deployed times themselves."""


@dataclass(frozen=True)
class SwitchLatency:
    """The verdict on P1c of a deployed module; `why` says why times are None. Times are in ns.

    `horizon` is H of the proof. `needed` is the least H, from the sample behind the last "AC"
    verdict to the first output of SC that acts. `largest` has the name and time of the largest
    summand. `diagnostics` has errors for times that the proof assumes and the thread does not keep.
    """

    module: str
    verdict: str
    horizon: int | None = None
    needed: int | None = None
    largest: tuple[str, int] | None = None
    why: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def slack(self) -> int | None:
        """H minus the least H needed, in ns; negative if P1c fails, None if it is not known."""
        return None if self.horizon is None or self.needed is None else self.horizon - self.needed

    def in_words(self) -> str:
        """The verdict and the latency in words."""
        if self.slack is None or self.horizon is None or self.needed is None:
            return f"P1c {self.verdict}: {self.why}"
        word = "spare" if self.slack >= 0 else "missing"
        name, ns = self.largest or ("", 0)
        why = f"{self.why}; " if self.why else ""
        return (
            f"P1c {self.verdict}: {why}H = {show_ns(self.horizon)}, needed {show_ns(self.needed)} "
            f"({show_ns(abs(self.slack))} {word}; largest: {name}, {show_ns(ns)})"
        )


def switch_latency_of(flat: System, module: Module) -> SwitchLatency:
    """The verdict on P1c of a module, by the execution times that the thread declares."""
    verify = module.symbol.verify
    if verify.span is None:
        return SwitchLatency(module.name, UNKNOWN, why="there is no `verify` block")
    if verify.induction is not None:
        return _latency_of_induction(flat, module)
    if module.forced is not None:
        return SwitchLatency(module.name, UNKNOWN, why=f"it is forced to {module.forced}")
    try:
        in_views = [_latency_in_view(flat, m) for flat, m in systems_by_view(flat, module)]
    except SoterError as error:
        return _latency_unknown(module, error.diagnostics)
    latencies = [s for s in in_views if s.slack is not None]
    switch = next((s for s in in_views if s.slack is None), None)
    switch = switch or min(latencies, key=lambda s: s.slack or 0)
    diagnostics = dict.fromkeys(d for s in in_views for d in s.diagnostics)
    return replace(switch, module=module.name, diagnostics=tuple(diagnostics))


def _latency_unknown(module: Module, refusals: tuple[Diagnostic, ...]) -> SwitchLatency:
    of_this = tuple(d for d in refusals if d.code in CODES_OF_DEPLOYED_TIMES)
    why = f"[{refusals[0].code}] {refusals[0].message}" if refusals else "`soter verify` says why"
    return SwitchLatency(module.name, UNKNOWN, why=why, diagnostics=of_this)


def _latency_of_induction(flat: System, module: Module) -> SwitchLatency:
    from soter.verify.induction.problem import extract_induction  # noqa: PLC0415 - only then

    try:
        extract_induction(*system_with_mode_topics(flat, module))
    except SoterError as error:
        return _latency_unknown(module, error.diagnostics)
    why = "every order of steps that the times allow is part of its proof"
    return SwitchLatency(module.name, HOLDS, why=why)


def _latency_in_view(flat: System, module: Module) -> SwitchLatency:
    """The verdict on P1c of a module in one of its views."""
    at = verification_system_of(flat, module)
    diagnostics = Diagnostics()
    kind = check_supported(at, diagnostics, synthesize=module.symbol.synthesized)
    if diagnostics.has_errors:
        return _latency_unknown(module, diagnostics.items)
    times, chains = times_of(at, kind, diagnostics)
    refusals = tuple(d for d in diagnostics.items if d.code in CODES_OF_DEPLOYED_TIMES)
    if any(d.code not in CODES_OF_DEPLOYED_TIMES for d in diagnostics.items):
        return _latency_unknown(module, diagnostics.items)
    assumed = assumed_times_of(times.schedule, chains)
    without_waiting = AssumedTimes(
        (0, 0), (0, 0), dict.fromkeys(assumed.nodes, (0, 0)), assumed.in_step
    )
    deployment = deployed_times(at.flat, at.home, without_waiting)
    assert deployment is not None
    if deployment.timing.verdict != "fits":
        return SwitchLatency(
            module.name, UNKNOWN, why="the calendar is not known to be kept", diagnostics=refusals
        )
    thread_times = Times(
        _schedule_with_thread_times(times.schedule, chains, deployment), horizon=times.horizon_ns
    )
    thread_times = times_without_delays(thread_times) if kind == "map" else thread_times
    needed = _least_horizon(
        thread_times.schedule, None if kind == "map" else deployment.handed_over
    )
    verdict = HOLDS if needed <= times.horizon_ns else FAILS
    why = "" if verdict == FAILS else _why_not_proved(times, refusals)
    return SwitchLatency(
        module=module.name,
        verdict=UNKNOWN if why else verdict,
        why=why,
        horizon=times.horizon_ns,
        needed=needed,
        largest=max(summands_of_h_star(thread_times).items(), key=lambda item: item[1]),
        diagnostics=refusals,
    )


def _why_not_proved(times: Times, refusals: tuple[Diagnostic, ...]) -> str:
    """Why `soter verify` does not prove P1c, although it holds as deployed; "" if it may do so."""
    if any(d.code == "R033" for d in refusals):
        return "the proof counts with other times (R033)"
    if times.h_star <= times.horizon_ns:
        return ""
    star = show_ns(times.h_star)
    return f"the times of its `verify` block need {star}, and those of the thread less"


def _least_horizon(schedule: Schedule, handed_over: int | None) -> int:
    """The least H, in ns.

    `handed_over`: the longest time from a release of the DM to the start of SC that follows. If it
    is known, and no node is behind SC, it replaces the sum in H*.
    """
    if handed_over is None or any(o.nodes for o in schedule.outputs):
        return schedule.least_horizon
    acts = schedule.sc.response + max(o.most for o in schedule.outputs)
    star = schedule.age_dm + schedule.dm.period + handed_over + acts
    return max(star, schedule.start) if schedule.sc_reads_more else star


def _schedule_with_thread_times(
    schedule: Schedule, chains: CauseEffectChains, deployment: DeployedTimes
) -> Schedule:
    """The schedule with the thread's own times for each component that runs in the thread."""

    def chain_in_thread(r: CauseEffectChain) -> CauseEffectChain:
        stations = zip(r.stations, r.path.nodes, strict=True)
        return replace(
            r,
            path=replace(
                r.path, nodes=tuple(_releases_in_thread(deployment, n.name, q) for n, q in stations)
            ),
        )

    by_dm = [chain_in_thread(r) for r in chains.by_dm]
    by_sc = [chain_in_thread(r) for r in chains.by_sc]
    releases = {n: _releases_in_thread(deployment, n.name, r) for n, r in chains.releases.items()}
    ways = CauseEffectChains(by_dm, by_sc, chains.ways, chains.beside, releases)
    least, acts = min(o.least for o in schedule.outputs), max(o.most for o in schedule.outputs)
    return replace(
        schedule,
        dm=replace(schedule.dm, late=deployment.dm[0], response=deployment.dm[1]),
        sc=replace(schedule.sc, late=deployment.sc[0], response=deployment.sc[1]),
        read_by_dm=tuple(r.path for r in by_dm),
        read_by_sc=tuple(r.path for r in by_sc),
        outputs=actuation_paths(ways, least, acts),
    )


def _releases_in_thread(deployment: DeployedTimes, name: str, at: Releases) -> Releases:
    late, response = deployment.nodes.get(name, (at.late, at.response))
    return replace(at, late=late, response=response)
