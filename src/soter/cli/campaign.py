"""`soter campaign FILE`: many seeded runs, and their statistics.

Purpose: flies, keeps every flight, and prints totals with exact confidence intervals, for people
and as JSON; it exits with 3 where a flight violated a property.
Non-goals: flying (`campaign/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, TypeAlias

from soter.cli.terminal.child_process import fork_into_child
from soter.cli.terminal.command_line import Pairs, at_least_one
from soter.cli.terminal.command_outcome import FINE, VIOLATED, CommandOutcome
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import CAMPAIGN_FOLDER, SET, SYSTEM, file_option
from soter.diagnostics.command_records import (
    SWITCH,
    JsonObject,
    Kind,
    Shape,
    one_of,
    option,
    read_by,
)

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping

    from soter.campaign.result import (
        Campaign,
        FaultAttribution,
        FlownArm,
        MetricResult,
        ModuleStatistics,
    )
    from soter.campaign.store import FlightOutcome

Flown: TypeAlias = "Campaign | FlownArm"

EXAMPLES = f"""\
  soter campaign cart.soter                       one hour of the default system
  soter campaign drone.soter --hours 104 --workers 2
  soter campaign drone.soter --flights 1000 --until 30s --system Twitching
  soter campaign drone.soter --hours 200          goes on where `--hours 104` ended
  soter campaign drone.soter --hours 104 --saves 10s --arms ac,paper,swept --report
  soter campaign drone.soter --workers ray        the cores of a Ray cluster; the same results
  soter run drone.soter --flight 48123 --report   look at the flight of that number

{CAMPAIGN_FOLDER}
Every flight stands in `flights.csv` of the campaign's folder, with its seed. It can be stopped at
any time; the same command goes on.

exit codes: 0 no violation, 1 diagnostics, 2 usage, 3 violations
"""


KEPT = "what was flown is kept: the same command goes on, or says why it cannot"
RAY_KEPT = f"Ray ends a process whose cluster's head is gone; {KEPT}"


def _workers_from_text(text: str) -> int | str:
    return text if text in ("local", "ray") else at_least_one(text)


def _name_list(text: str) -> tuple[str, ...]:
    return tuple(n.strip() for n in text.split(",") if n.strip())


@dataclass(frozen=True, kw_only=True)
class Options:
    """Fly many seeds of a system, and count."""

    file: str = file_option()
    system: str | None = option(*SYSTEM)
    hours: float | None = option("--hours H", None, "of flight, in all (1)", read_by(float))
    flights: int | None = option("--flights N", None, "in place of --hours", Kind("bound"))
    until: str | None = option("--until TIME", None, "of each; by default the system's own")
    seed: int = option("--seed N", 1, "of the first (1)", Kind("seed"))
    workers: int | str | None = option(
        "--workers N", None, "threads, `local`: one a core, or `ray`", read_by(_workers_from_text)
    )
    arms: tuple[str, ...] = option(
        "--arms A,B",
        (),
        "also fly the same seeds by other rules: ac, paper, swept",
        read_by(_name_list),
    )
    saves: str | None = option(
        "--saves TIME", None, "count saves: fly AC on for so long where it is taken off"
    )
    report: str | None = option("--report [FILE]", None, "write the HTML page (DIR/report.html)")
    parquet: bool = option("--parquet", False, "also write DIR/flights.parquet", SWITCH)
    params: Pairs = option(*SET)
    output: str | None = option("-o DIR", None, "the folder (.soter/campaign-...)")


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Flies the campaign, prints its totals and writes its pages; VIOLATED after a violation."""
    from soter.api.campaigning import (  # noqa: PLC0415 - needs NumPy
        campaign_settings,
        write_campaign,
    )
    from soter.campaign.store import require_parquet  # noqa: PLC0415 - only to fly

    program = loaded_program(args, console)
    if program.externs or args.workers == "ray":  # linked C may crash; Ray may end its process
        fork_into_child(console, lambda _: (RAY_KEPT if args.workers == "ray" else KEPT,))
    try:
        if args.parquet:
            require_parquet()
        with ProgressBar(console) as progress:
            campaign = program.campaign(
                args.system, dict(args.params), progress=progress, **campaign_settings(vars(args))
            )
            pages = write_campaign(campaign, program.path, args.report, parquet=args.parquet)
    except KeyboardInterrupt:
        console.note(KEPT)
        raise
    _say_campaign(campaign, console)
    for page in pages:
        console.say(f"written {page}")
    code = VIOLATED if campaign.result.violations else FINE
    return CommandOutcome(code, campaign.diagnostics, DOCUMENT.of(campaign))


def _say_campaign(campaign: Campaign, console: Console) -> None:
    from soter.campaign import tables  # noqa: PLC0415 - only here

    r = campaign.result
    _say_hours_flown(campaign, console)
    colour = "bad" if r.violations else "good" if r.properties else ""
    painted, limits = console.paint(colour, tables.verdict_text(r)), tables.bound_text(r)
    console.say("\n" + painted + (f"; with 95 % confidence {limits}" if limits else ""))
    if r.violations and campaign.faults:
        console.say(tables.faults_text(r))
    for text, count in r.broken:
        console.say(f"  {count} x {text}")
    for f in r.worst:
        console.say(f"  flight {f.number}, seed {f.seed}: first at {f.first_s:.3f} s")
    for heads, rows in (
        tables.modules_table(campaign),
        tables.measures_table(campaign),
        tables.arms_table(campaign),
        tables.faults_table(campaign),
    ):
        if rows:
            console.say("\n" + console.table(heads, rows))
    if len(r.modules) > 1:
        console.say(f"\nall modules in AC at once: {r.ac_share:.2%} of the time")
    if campaign.lateness:
        console.say(f"\nlateness of arm `paper`: {campaign.lateness}")
    speed = campaign.flown * campaign.until_s / campaign.wall_s if campaign.flown else 0.0
    console.say(
        f"\nflights {campaign.folder}/flights.csv   "
        f"{campaign.wall_s:.1f} s" + (f", {speed:,.0f} x real time" if speed else ", flown before")
    )
    console.say(console.paint("muted", f"digest  {r.digest}"))


def _say_hours_flown(campaign: Campaign, console: Console) -> None:
    r = campaign.result
    console.say(
        f"{campaign.system}: {r.hours:,.2f} h in {r.flights:,} flights of {campaign.until_s:g} s, "
        f"seeds {campaign.first_seed} to {campaign.first_seed + r.flights - 1}"
    )
    way = [f"{r.hours_aloft:,.2f} h aloft"] if r.hours_aloft is not None else []
    way += [f"{r.km:,.1f} km"] if r.km is not None else []
    if way:
        console.say(", ".join(way))


# ---------------------------------------------------------------- for programs


@dataclass(frozen=True)
class ViolatedFlight:
    """A flight that violated a property, and whether the faults in it caused the violation."""

    flight: FlightOutcome
    blame: FaultAttribution


@dataclass(frozen=True)
class ExcusingFault:
    """An outside fault. `flights`: clean without it alone; `met`: met it, clean without any."""

    flights: int
    met: int


@dataclass(frozen=True)
class CampaignFault:
    """A fault. `inside`: the assumption it respects, or None; `times`: None if it always acts."""

    fault: str
    inside: str | None
    times: int | None


def _finite_or_none(*numbers: float) -> list[float | None]:
    return [x if isfinite(x) else None for x in numbers]


def _hours_counted(c: Flown) -> str:
    return "all" if c.result.hours_aloft is None else "aloft"


def _violations_per_hour(c: Flown) -> list[float | None]:
    return _finite_or_none(*c.result.per_hour)


def _flights_violated_outside(c: Flown) -> int:
    return c.result.flights_violated - c.result.violated_inside


def _excusing_faults(c: Flown) -> dict[str, ExcusingFault]:
    return {text: ExcusingFault(n, met) for text, n, met in c.result.excused}


def _disengagement_count(c: Flown) -> int:
    return sum(m.disengagements for m in c.result.modules)


def _episode_count(c: Flown) -> int:
    return sum(m.episodes for m in c.result.modules)


def _counts_saves(c: Flown) -> bool:
    return bool(c.result.modules) and c.result.modules[0].saves is not None


def _save_count(c: Flown) -> int | None:
    return sum(m.saves or 0 for m in c.result.modules) if _counts_saves(c) else None


def _precaution_count(c: Flown) -> int | None:
    return sum(m.precautions or 0 for m in c.result.modules) if _counts_saves(c) else None


def _modules_by_name(c: Flown) -> dict[str, ModuleStatistics]:
    return {m.name: m for m in c.result.modules}


def _episodes_per_hour(m: ModuleStatistics) -> list[float | None]:
    return _finite_or_none(*m.per_hour)


def _measures_by_name(c: Flown) -> dict[str, MetricResult]:
    return {m.name: m for m in c.result.measures}


def _mean_or_none(m: MetricResult) -> float | None:
    return _finite_or_none(m.mean)[0]


def _least_or_none(m: MetricResult) -> float | None:
    return _finite_or_none(m.least)[0]


def _most_or_none(m: MetricResult) -> float | None:
    return _finite_or_none(m.most)[0]


def _violated_flights(c: Flown) -> list[ViolatedFlight]:
    return [ViolatedFlight(*x) for x in zip(c.result.worst, c.result.blames, strict=True)]


def _arms_by_name(c: Campaign) -> dict[str, FlownArm]:
    return {a.name: a for a in c.arms}


def _campaign_faults(c: Campaign) -> list[CampaignFault]:
    return [CampaignFault(text, keeps or None, c.occurred[text]) for text, keeps in c.faults]


BASIS = one_of("poisson", "flights")
FIGURES = (
    "hours=result.rate_hours hours_of hours_flown=result.hours km=result.km flights=result.flights "
    "distinct_flights=result.distinct properties=result.properties violations=result.violations "
    "violations_per_hour violations_basis=result.per_hour_basis "
    "flights_violated=result.flights_violated violated_per_flight=result.per_flight "
    "violated_inside=result.violated_inside violated_outside excused disengagements episodes saves "
    "precautions ac_share=result.ac_share modules measures broken=result.broken* violated_flights "
    "digest=result.digest"
)
MADE = {
    "hours_of": _hours_counted,
    "violations_per_hour": _violations_per_hour,
    "violated_outside": _flights_violated_outside,
    "excused": _excusing_faults,
    "disengagements": _disengagement_count,
    "episodes": _episode_count,
    "saves": _save_count,
    "precautions": _precaution_count,
    "modules": _modules_by_name,
    "measures": _measures_by_name,
    "violated_flights": _violated_flights,
}
SHAPES: Mapping[str, Shape] = {
    "hours_of": one_of("aloft", "all"),
    "violations_basis": BASIS,
    "excused": JsonObject(ExcusingFault, "flights met"),
    "modules": JsonObject(
        "soter.campaign.result.ModuleStatistics",
        "ac_share disengagements episodes episodes_per_hour episodes_basis=basis gate_faults saves "
        "precautions",
        {"episodes_per_hour": _episodes_per_hour},
        episodes_basis=BASIS,
    ),
    "measures": JsonObject(
        "soter.campaign.result.MetricResult",
        "mean least most edges histogram=bins",
        {"mean": _mean_or_none, "least": _least_or_none, "most": _most_or_none},
    ),
    "violated_flights": JsonObject(
        ViolatedFlight,
        "flight=flight.number seed=flight.seed first_s=flight.first_s what=flight.broken "
        "outside=blame.met clean_without=blame.clean_without needed=blame.needed",
    ),
}
DOCUMENT = JsonObject(
    "soter.campaign.result.Campaign",
    f"program_sha256 system {FIGURES} flight_s=until_s seed=first_seed saves_horizon_s=horizon_s? "
    "arms lateness=lateness? faults folder wall_s workers",
    {**MADE, "arms": _arms_by_name, "faults": _campaign_faults},
    beside={"file": str},
    shapes=SHAPES,
    arms=JsonObject(
        "soter.campaign.result.FlownArm", f"text {FIGURES}", MADE, named="arm", shapes=SHAPES
    ),
    faults=JsonObject(CampaignFault, "fault inside times"),
)
