"""Runs a campaign of a program: its system, folder, flights, arms, and warnings.

Purpose: `campaign` is what `soter campaign` and `Program.campaign` do.
Non-goals: flying (`campaign/`), printing.
"""

from __future__ import annotations

import os
import re
import time
from contextlib import ExitStack
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import run_end_ns, time_ns
from soter.api.output_files import require_writable
from soter.campaign.arms import OURS, PAPER, Arm, find_arms
from soter.campaign.batch_flights import Fleet
from soter.campaign.fly_campaign import RayCluster, fly, fly_batches, join_cluster, require_ray
from soter.campaign.page import write_page
from soter.campaign.release_lateness import Lateness, stored_lateness
from soter.campaign.result import ORDER, Campaign, FlownArm, attributions, count_faults, make_result
from soter.campaign.store import CampaignIdentity, CampaignStore, write_parquet
from soter.diagnostics.diagnostic import Diagnostic, Severity, SoterError, mistake
from soter.language.evaluate.topic_ranges import truth_by_parts
from soter.native.extern_bindings import bindings_of_derived
from soter.report.wording import changed_parameters
from soter.simulate.run_options import seed_value

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.campaign.result import Result
    from soter.campaign.store import FlightOutcome
    from soter.language.model.system import System
    from soter.native.extern_bindings import Bindings

    Progress = Callable[[float], None]

HOURS_MAX = 1e7
WORKERS_MAX = 256
LOCAL, RAY = "local", "ray"


def campaign(
    bindings: Bindings,
    path: str,
    *,
    hours: float | None = None,
    flights: int | None = None,
    until: float | str | None = None,
    seed: int = 1,
    workers: int | str | None = None,
    output: str | Path | None = None,
    arms: Sequence[str] = (),
    saves: float | str | None = None,
    lateness_s: float = 20.0,
    progress: Progress | None = None,
) -> Campaign:
    """Flies `flights` seeds, or as many as make `hours` of flight (1 h by default).

    Flight k is the run of seed `seed` + k. `workers`: the number of threads; "local", the default:
    a thread for each core; "ray": the cores of a Ray cluster; results are the same. A campaign of
    the same program, system, time, parameters and seed continues in its folder `output` where it
    stopped, and may be made longer. `arms`: also fly `ac`, `paper` or `swept` on these seeds;
    `lateness_s`: how long to measure this machine for the paper's rules. `saves`: count saves;
    after AC lost control, fly it on for this time (seconds or text). Raises SoterError U001 (wrong
    numbers), C006 (nothing is judged), U003 (extern nodes), D006 (folder), D007, D018 (cluster).
    """
    began = time.perf_counter()
    flat, core, until_ns = bindings.system, bindings.core, run_end_ns(bindings.system, until)
    count = _flight_count(hours, flights, until_ns)
    threads, horizon_ns = _thread_count(workers), _horizon_of_saves_ns(saves)
    about = _campaign_identity(flat, path, until_ns, seed, horizon_ns)
    folder = Path(output) if output is not None else _default_folder(path, about)
    fleet = Fleet(flat, until_ns, core=core, horizon_ns=horizon_ns)
    _require_judged(flat)
    lateness, others = _lateness_and_arms(flat, arms, folder, lateness_s)
    about = replace(about, **fleet.code_fields())
    todo = [(OURS, "the system as it is declared", fleet, folder, about)]
    for arm in others:
        other = Fleet(arm.system, until_ns, core=bindings_of_derived(bindings, arm.system).core)
        of = _campaign_identity(arm.system, path, until_ns, seed, 0)
        at = _lateness_quantiles_ns(lateness)
        identity = replace(of, arm=arm.name, lateness=at, **other.code_fields())
        todo.append((arm.name, arm.text, other, folder / f"arm-{arm.name}", identity))
    whole = progress or _ignore_progress
    shares = [_progress_of_part(whole, k, len(todo)) for k in range(len(todo))]
    with ExitStack() as held:
        crew = threads or held.enter_context(join_cluster())
        flown = [_fly_arm(*one, count, crew, t) for one, t in zip(todo, shares, strict=True)]
    ours = flown[0]
    return Campaign(
        system=flat.name,
        until_s=until_ns / 1e9,
        first_seed=about.first_seed,
        folder=folder,
        flights=ours.flights,
        result=ours.result,
        flown=ours.flown,
        wall_s=time.perf_counter() - began,
        workers=crew if isinstance(crew, int) else crew.cores,
        arms=tuple(flown) if others else (),
        lateness=lateness.as_text() if lateness else "",
        horizon_s=horizon_ns / 1e9,
        program_sha256=flat.program.sha256,
        params=about.params,
        asked_arms=tuple(arms),
        forced=tuple(f"{m.name} to {m.forced.upper()}" for m in flat.modules if m.forced),
        faults=_faults_with_assumptions(flat),
        occurred=count_faults(flat, [f.seed for f in ours.flights], until_ns),
        diagnostics=tuple(_campaign_warnings(flat, ours.result)),
        properties=tuple(f"{p.kind} {p.text}" for p in flat.properties),
    )


def _horizon_of_saves_ns(saves: float | str | None) -> int:
    """How long AC flies on after it lost control, in ns; 0 if `saves` is None. Raises U001."""
    horizon_ns = time_ns("saves", saves) or 0
    if saves is not None and horizon_ns <= 0:
        raise mistake("U001", "saves need a time for which AC is flown on", "as `--saves 10s`")
    return horizon_ns


def _require_judged(flat: System) -> None:
    """Raises SoterError C006 if the system has no property or measure to judge flights by."""
    if not flat.properties and not flat.measures:
        raise SoterError((_no_property_diagnostic(flat, Severity.ERROR),))


def _campaign_warnings(flat: System, r: Result) -> Iterator[Diagnostic]:
    """Yields a warning for each conclusion that the flights of a campaign do not support."""
    if not flat.properties:
        yield _no_property_diagnostic(flat, Severity.WARNING)
    for p in flat.properties:
        wanted = {"always": True, "never": False}.get(p.kind)
        if wanted is not None and truth_by_parts(p.condition, flat, p.scope) is wanted:
            message = f"no flight can violate `{p.kind} {p.text}`, whatever values it reads"
            yield Diagnostic("C006", message, severity=Severity.WARNING)
    if r.distinct < r.flights:
        message = (
            f"all {r.flights:,} flights are copies of one: nothing in them is left to chance"
            if r.distinct == 1
            else f"{r.flights - r.distinct:,} of {r.flights:,} flights are copies of others"
        )
        of = "one flight" if r.distinct == 1 else f"{r.distinct:,} flights"
        note = f"bounds are no closer than those of {of}"
        helps = ("`choose`, inputs, disturbances and faults make flights differ",)
        yield Diagnostic("C007", message, notes=(note,), helps=helps, severity=Severity.WARNING)


def _no_property_diagnostic(flat: System, severity: Severity) -> Diagnostic:
    message = f"system `{flat.name}` has no property: no flight of it can be violated"
    helps = ["say what shall hold: `always CONDITION;` in the system"]
    if severity is Severity.ERROR:
        helps.append("to measure only: `measure NAME = EXPRESSION in [a, b] / BINS every T;`")
    return Diagnostic("C006", message, helps=tuple(helps), severity=severity)


def _thread_count(workers: int | str | None) -> int:
    """The number of threads that fly; 0 if a Ray cluster flies. Raises U001 or D007."""
    if workers == RAY:
        require_ray()
        return 0
    threads = os.cpu_count() or 1 if workers in (None, LOCAL) else workers
    if not isinstance(threads, int) or not 1 <= threads <= WORKERS_MAX:
        help_ = f"give 1 to {WORKERS_MAX}, `{LOCAL}` or `{RAY}`"
        raise mistake("U001", f"{workers} workers cannot fly", help_)
    return threads


def _faults_with_assumptions(flat: System) -> tuple[tuple[str, str], ...]:
    """Pairs of a fault's text and the assumption that it respects in all components, or ""."""
    places_by_fault: dict[str, list[str | None]] = {ORDER: [None]} if flat.shuffled else {}
    for f in (f for f in flat.faults if f.on is None):
        places_by_fault.setdefault(f.text, []).append(f.inside)
    return tuple(
        (t, next(iter(w)) or "" if None not in w else "") for t, w in places_by_fault.items()
    )


def own_folder(flat: System, path: str, until: Any, seed: int) -> Path:  # noqa: ANN401
    """The default folder of a campaign of this system. Raises U001 if a run has no end."""
    return _default_folder(path, _campaign_identity(flat, path, run_end_ns(flat, until), seed, 0))


def _campaign_identity(
    flat: System, path: str, until_ns: int, seed: int, horizon_ns: int
) -> CampaignIdentity:
    return CampaignIdentity(
        program=Path(path).name,
        program_sha256=flat.program.sha256,
        system=flat.name,
        params={name: text for name, (text, _) in changed_parameters(flat).items()},
        until_ns=until_ns,
        first_seed=seed_value(seed),
        modules=[m.name for m in flat.modules],
        measures=[m.name for m in flat.measures],
        horizon_ns=horizon_ns,
        faults=sorted({f.text for f in flat.faults if f.on is None})
        + ([ORDER] if flat.shuffled else []),
    )


def _lateness_and_arms(
    flat: System, names: Sequence[str], folder: Path, seconds: float
) -> tuple[Lateness | None, list[Arm]]:
    """The lateness of this machine if an arm needs it, else None; the arms besides the system."""
    find_arms(flat, [n for n in names if n != PAPER], ())  # raises for wrong names
    lateness = None
    if PAPER in names:
        folder.parent.mkdir(parents=True, exist_ok=True)
        lateness = stored_lateness(folder.parent / f"{folder.name}-lateness.json", seconds)
    return lateness, find_arms(flat, names, lateness.quantiles_ns if lateness else ())[1:]


def _lateness_quantiles_ns(lateness: Lateness | None) -> list[int]:
    return list(lateness.quantiles_ns) if lateness else []


def _fly_arm(
    name: str,
    text: str,
    fleet: Fleet,
    folder: Path,
    about: CampaignIdentity,
    count: int,
    workers: int | RayCluster,
    progress: Progress,
) -> FlownArm:
    began = time.perf_counter()
    store = CampaignStore(folder, about)
    before = len(store.flights)
    try:
        if before < count:
            fly(fleet, store, count, workers, progress)
    finally:
        store.close()
    wanted = store.flights[:count]

    def fly_arm(other: System, numbers: Sequence[int]) -> Iterator[FlightOutcome]:
        compiled = Fleet(other, fleet.until_ns, core=fleet.core)  # with the same externs
        for some in fly_batches(compiled, numbers, about.first_seed, workers):
            yield from some

    bad = [f for f in wanted if f.violations]
    return FlownArm(
        name=name,
        text=text,
        system=fleet.system,
        folder=folder,
        flights=tuple(wanted),
        result=make_result(wanted, fleet.system, attributions(fleet.system, bad, fly_arm)),
        flown=max(count - before, 0),
        wall_s=time.perf_counter() - began,
    )


def _progress_of_part(progress: Progress, k: int, count: int) -> Progress:
    return lambda share: progress((k + share) / count)


def _ignore_progress(_: float) -> None:
    pass


def _flight_count(hours: float | None, flights: int | None, until_ns: int) -> int:
    if hours is not None and flights is not None:
        raise mistake("U001", "`hours` and `flights` say the same", "give one of them")
    if flights is not None:
        if flights < 1:
            raise mistake("U001", f"{flights} flights say nothing", "give 1 at least")
        return flights
    wanted = 1.0 if hours is None else hours
    if not 0.0 < wanted <= HOURS_MAX:  # NaN, too
        limit = f"give more than 0 and at most {HOURS_MAX:g}"
        raise mistake("U001", f"{wanted:g} hours cannot be flown", limit)
    if until_ns <= 0:
        raise mistake("U001", "flights of no time make no hours", "give a time with `until`")
    return ceil(wanted * 3600.0e9 / until_ns)


def _default_folder(path: str, about: CampaignIdentity) -> Path:
    parts = [Path(path).stem, about.system, f"{about.until_ns / 1e9:g}s", str(about.first_seed)]
    parts += [f"{k}={v}" for k, v in about.params.items()]
    name = re.sub(r"[^A-Za-z0-9_.=+-]", "_", "-".join(parts))[:120]
    return Path(".soter") / f"campaign-{name}"


def write_campaign(
    flown_campaign: Campaign, path: str, report: str | Path | None, *, parquet: bool = False
) -> list[Path]:
    """Writes a campaign's page (`report` "": beside the flights) and tables; raises D006, D007."""
    made: list[Path] = []
    if report is not None:
        target = Path(report or flown_campaign.folder / "report.html")
        require_writable(target)
        made.append(write_page(flown_campaign, path, target))
    if parquet:
        folders = dict.fromkeys([flown_campaign.folder, *(a.folder for a in flown_campaign.arms)])
        made += [write_parquet(folder) for folder in folders]
    return made


def campaign_settings(args: Mapping[str, Any]) -> dict[str, Any]:
    """Selects the keyword arguments of `campaign` from those of a command line."""
    names = ("hours", "flights", "until", "seed", "workers", "output", "arms", "saves")
    return {n: args[n] for n in names}
