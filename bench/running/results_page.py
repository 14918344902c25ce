"""The paper's rigorous simulation, and why others would have had crashes: writes docs/results.md.

    .venv/bin/python bench/running/results_page.py [--hours H] [--stack N] [--laps N] [--out DIR]

Four campaigns: the whole drone for as many hours as make 104 h aloft and 1,505 km, with faults
inside of what its proofs assume and saves counted; the same seeds with faults outside besides; the
same stack by other rules on N seeds; the laps of examples/drone/motion_primitive.soter, whose AC
overshoots, by other rules on N seeds. Each is resumable in the folder DIR. Behind them stands
what docs/benchmarks.md has of an autopilot's firmware. No sentence of the page stands in this file
as it is: figures are filled in, and which one is said depends on them. Exit code 1 where a flight
is violated that no fault outside excuses, a flight is another one when it is run again, or an hour
or a kilometre is missing.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import soter
from soter.campaign.batch_flights import EVENT, TO_AC, TO_SC
from soter.campaign.statistics import garwood_interval
from soter.campaign.tables import (
    bound_text,
    faults_table,
    faults_text,
    interval_text,
    quoted_names,
    rate_unit,
    verdict_text,
)

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.benchmark_rows import BENCHMARKS  # noqa: E402 - needs the path
from bench.run_all import results  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.api.program import Program
    from soter.campaign.result import Campaign, FlownArm, Result
    from soter.language.model.system import System

DRONE = ROOT / "examples" / "drone"
PAGE = ROOT / "docs" / "results.md"
ARMS = ("ac", "paper", "swept")
HOURS, KM = 104.0, 1505.0
PAPERS_CRASHES, PAPERS_TAKEOVERS = 34, 109
CRASH = "always city.NoCollision(d.truth.p)"
MOTION = "SafeMotionPrimitive"
FIRMWARE = "On the firmware of a real autopilot"
PAPERS_FIRMWARE = "The paper flew PX4's firmware in the loop; this is Betaflight's, unmodified."
HOW = "[autopilot.md](autopilot.md)"
ON_FIRMWARE = ("Betaflight below a proved geofence", "Betaflight on the drone's laps")
AGAIN = 3
"""Flights of a campaign that are run again, without a violation."""


def crashes(arm: FlownArm) -> int:
    """Flights in which the vehicle touched something."""
    return sum(CRASH in f.broken for f in arm.flights)


def row(*cells: object) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def beside_the_paper(campaign: Campaign, outside: Campaign) -> Iterator[str]:
    """Our figures beside those of the paper's Section V-D."""
    ours = [list(figures(c)) for c in (campaign, outside)]
    papers = {
        "simulated": f"{HOURS:g} h in Gazebo",
        "flown": f"about {KM:,.0f} km",
        "violations": f"{PAPERS_CRASHES} crashes",
        "violations an hour aloft, 95 %": interval_text(*garwood_interval(PAPERS_CRASHES, HOURS)),
        "takeovers": f"{PAPERS_TAKEOVERS}",
        f"AC share, {MOTION}": "> 96 %",
    }
    yield row("", "the paper", f"`{campaign.system}`", f"`{outside.system}`")
    yield row(*["---"] * 4)
    for (name, inside), (_, other) in zip(*ours, strict=True):
        yield row(name, papers.get(name, "-"), inside, other)


def figures(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """What is told of a campaign, by name."""
    r = campaign.result
    speed, height, clearance = (
        next(m for m in r.measures if m.name == name) for name in ("speed", "height", "clearance")
    )
    episodes = sum(m.episodes for m in r.modules)
    saves = sum(m.saves or 0 for m in r.modules)
    hour = rate_unit(r)
    inside = sum(1 for _, why in campaign.faults if why)
    yield (
        "faults inside, outside of what proofs assume",
        f"{inside}, {len(campaign.faults) - inside}",
    )
    yield "simulated", f"{r.hours:,.1f} h, {r.rate_hours:,.1f} h of it aloft"
    yield "flights, of them distinct", f"{r.flights:,}, {r.distinct:,}"
    yield "flown", f"{r.km or 0.0:,.0f} km, below {height.most:.1f} m"
    yield "violations", f"{r.violations:,} in {r.flights_violated:,} flights"
    yield "violated flights that no fault outside excuses", f"{r.violated_inside:,}"
    yield f"violations {hour}, 95 %", f"{interval_text(*r.per_hour)} ({r.per_hour_basis})"
    yield "takeovers", f"{sum(m.disengagements for m in r.modules):,}"
    yield "episodes (takeovers within 2 s are one)", f"{episodes:,}"
    yield "saves, precautions", f"{saves:,}, {episodes - saves:,}"
    yield f"saves {hour}", f"{saves / r.rate_hours:.2f}"
    for m in r.modules:
        yield f"AC share, {m.name}", f"{m.ac_share:.2%}"
        yield f"episodes {hour}, 95 %, {m.name}", f"{interval_text(*m.per_hour)} ({m.basis})"
    yield "all modules in AC at once", f"{r.ac_share:.2%}"
    yield "mean speed aloft", f"{speed.mean * r.hours / r.rate_hours:.2f} m/s"
    yield "least clearance of the hull", f"{clearance.least:.2f} m"


def histogram(campaign: Campaign, name: str, width: int = 40) -> Iterator[str]:
    """A measure as bars of text: five bins together."""
    m = next(x for x in campaign.result.measures if x.name == name)
    inner, total = m.bins[1:-1], sum(m.bins)
    groups = [(m.edges[k], m.edges[min(k + 5, len(inner))], sum(inner[k : k + 5]))
              for k in range(0, len(inner), 5)]  # fmt: skip
    most = max(n for _, _, n in groups)
    yield "```"
    for low, high, n in groups:
        if n:
            yield f"{low:5.2f} to {high:5.2f}  {n / total:8.4%}  {'#' * round(width * n / most)}"
    if m.bins[-1]:
        yield f"above {m.edges[-1]:g}      {m.bins[-1] / total:8.4%}"
    yield "```"


def other_rules(campaign: Campaign) -> Iterator[str]:
    """Crashes and violations by arm."""
    yield row("arm", "flights", "crashed", "violated anything", "of them clean without what is "
              "outside", "all in AC", "what is different")  # fmt: skip
    yield row(*["---"] * 7)
    for a in campaign.arms:
        r = a.result
        yield row(
            a.name, f"{r.flights:,}", f"{crashes(a):,}", f"{r.flights_violated:,}",
            f"{r.flights_violated - r.violated_inside:,}", f"{r.ac_share:.1%}", a.text,
        )  # fmt: skip


# ---------------------------------------------------------------- sentences


def introduction(again: list[bool]) -> str:
    """How the page came about, and whether flights are what they were."""
    same = "all to the digest" if all(again) else f"{again.count(False)} of them NOT to the digest"
    return (
        "Written by `python bench/running/results_page.py`, sentences and all. "
        f"{len(again)} flights without a violation were run again by `soter run` for it, {same} "
        "that stands in `flights.csv`. What the words mean: [campaigns.md](campaigns.md)."
    )


def title(inside: Result, outside: Result) -> str:
    """Our figures of both campaigns, beside the paper's."""
    both = (inside, outside)
    violations, hours, km = (
        " and ".join(dict.fromkeys(texts))
        for texts in (
            [f"{r.violations:,}" for r in both],
            [f"{r.rate_hours:,.0f}" for r in both],
            [f"{r.km or 0.0:,.0f}" for r in both],
        )
    )
    each = "two campaigns" if " and " in hours + km else "each of two campaigns"
    return (
        f"Results: {violations} violations in {hours} h aloft and {km} km of {each}; "
        f"the paper: {PAPERS_CRASHES} crashes in {HOURS:g} h and {KM:,.0f} km of another simulator"
    )


def simulators(campaign: Campaign) -> str:
    """What the two columns do not compare, by what the arm `paper` did in ours."""
    papers = next((a for a in campaign.arms if a.name == "paper"), None)
    told = (
        "The paper flew in Gazebo, this is Soter's own simulator: fewer crashes here are no "
        "comparison of the two designs."
    )
    if papers is None:
        return told
    count, flights = crashes(papers), f"{papers.result.flights:,}"
    said = f"none of {flights} flights crashed in ours either"
    said = said if count == 0 else f"{count:,} of {flights} flights crashed in ours, too"
    return f"{told} By the paper's rules (arm `paper` below) {said}."


def judged(campaign: Campaign, flat: System) -> str:
    """What counts as a violation, and what came of it."""
    what = quoted_names([f"{p.kind} {p.text}" for p in flat.properties])
    r = campaign.result
    text = faults_text(r)
    because = f" {text[0].upper()}{text[1:]}." if r.violations and campaign.faults else ""
    return (
        f"A violation of `{campaign.system}` is one of {what}: {verdict_text(r)} in "
        f"{r.rate_hours:,.1f} h, "
        f"with 95 % confidence {bound_text(r)}.{because}"
    )


def declared(campaign: Campaign) -> str:
    """How many faults there are, and where they stand to the assumptions."""
    count = len(campaign.faults)
    inside = sum(1 for _, why in campaign.faults if why)
    if not count:
        return f"Nothing was declared to go wrong in `{campaign.system}`."
    if inside == count:
        return (
            f"In `{campaign.system}` {count} faults were declared, all of them inside of what the "
            "proofs assume:"
        )
    return (
        f"In `{campaign.system}` {count} faults were declared, {inside} of them inside of what the "
        f"proofs assume and {count - inside} outside:"
    )


def broken(campaign: Campaign) -> list[str]:
    """What was violated, a row each."""
    rows = [row("times", "violated"), row("---", "---")]
    rows += [row(f"{n:,}", f"`{what}`") for what, n in campaign.result.broken]
    return [*rows, ""] if campaign.result.broken else []


def lateness(campaign: Campaign) -> str:
    """What the arm `paper` was flown with."""
    return f"Lateness of `paper`: {campaign.lateness}."


def table(campaign: Campaign) -> list[str]:
    """The faults of a campaign."""
    head, rows = faults_table(campaign)
    if not rows:
        return []
    return [row(*head), row(*["---"] * len(head)), *(row(*cells) for cells in rows), ""]


def prose(text: str) -> list[str]:
    """A paragraph, in lines."""
    lines = textwrap.wrap(
        " ".join(text.split()), 119, break_long_words=False, break_on_hyphens=False
    )
    return [*lines, ""]


def page(
    campaigns: tuple[Campaign, Campaign], rules: Campaign, laps: Campaign, again: list[bool],
    flats: tuple[System, System],
) -> str:  # fmt: skip
    """The whole page."""
    stack, outside = campaigns
    lines = [f"# {title(stack.result, outside.result)}", "", *prose(introduction(again))]
    lines += ["## The whole drone, beside the paper's rigorous simulation", ""]
    lines += prose(simulators(rules))
    lines += [*beside_the_paper(stack, outside), ""]
    for campaign, flat in zip(campaigns, flats, strict=True):
        lines += [f"### {campaign.system}", "", *prose(judged(campaign, flat)), *broken(campaign)]
        lines += [*prose(declared(campaign)), *table(campaign)]
        every = next(m.every_ns for m in flat.measures if m.name == "clearance") / 1e6
        lines += [
            *prose(f"`clearance`, m, every {every:g} ms:"),
            *histogram(campaign, "clearance"),
            "",
        ]
        lines += prose(
            f"Saves are counted with a horizon of {campaign.horizon_s:g} s. Digest of the "
            f"{campaign.result.flights:,} flights: `{campaign.result.digest[:16]}`."
        )
    lines += ["## The same seeds by other rules: the stack", ""]
    lines += [*other_rules(rules), "", *prose(lateness(rules))]
    lines += ["## The same seeds by other rules: laps with an AC that overshoots", ""]
    lines += [*other_rules(laps), "", *prose(lateness(laps))]
    return "\n".join([*lines, *on_firmware()]) + "\n"


def on_firmware() -> list[str]:
    """What stands in docs/benchmarks.md of flights of a real autopilot's firmware."""
    lines = [f"## {FIRMWARE}", "", *prose(f"{PAPERS_FIRMWARE} How, and what it rests on: {HOW}.")]
    kept = results()
    for b in BENCHMARKS:
        if b.name in ON_FIRMWARE:
            lines += [f"### {b.name}", "", f"`{kept[b.name].command}`", "", kept[b.name].about, ""]
            lines += [kept[b.name].text, ""]
    return lines[:-1]


# ---------------------------------------------------------------- flown again


def run_again(program: Program, campaign: Campaign) -> Iterator[bool]:
    """Whether flights without a violation, evenly over a campaign, are those of `soter run`."""
    clean = [f for f in campaign.flights if not f.violations]
    for k in range(min(AGAIN, len(clean))):
        flight = clean[k * (len(clean) - 1) // max(AGAIN - 1, 1)]
        run = program.simulate(campaign.system, campaign.until_s, flight.seed, trace=False)
        events = [(c.time_ns, TO_AC if c.to == "AC" else TO_SC, c.module) for c in run.changes]
        said = np.array(events, dtype=EVENT).tobytes() + run.final.tobytes()
        yield hashlib.sha256(said).hexdigest() == flight.digest


def main() -> int:
    """Fly, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=195.0)
    parser.add_argument("--stack", type=int, default=60)
    parser.add_argument("--laps", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=ROOT / ".soter" / "results")
    parser.add_argument("--page", type=Path, default=PAGE)
    args = parser.parse_args()
    program = soter.load(DRONE / "campaign.soter")
    how = {"hours": args.hours, "saves": "10s"}
    stack = program.campaign("Surveillance", output=args.out / "inside", **how)
    outside = program.campaign("Outside", output=args.out / "outside", **how)
    rules = program.campaign(flights=args.stack, arms=ARMS, output=args.out / "rules")
    overshoots = soter.load(DRONE / "motion_primitive.soter")
    laps = overshoots.campaign("Protected", flights=args.laps, arms=ARMS, output=args.out / "laps")
    again = [x for c in (stack, outside) for x in run_again(program, c)]
    flats = (program.flat("Surveillance"), program.flat("Outside"))
    written = page((stack, outside), rules, laps, again, flats)
    args.page.write_text(written, encoding="utf-8")
    right = all(again) and (stack.result.km or 0.0) >= KM
    for name, r in (("inside", stack.result), ("outside", outside.result)):
        right &= r.rate_hours >= HOURS and r.violated_inside == 0
        print(f"{name}: {r.violations} violations, {r.rate_hours:,.1f} h aloft, {r.km:,.0f} km")
    right &= all(why for _, why in stack.faults)
    right &= stack.result.violations == rules.result.violations == laps.result.violations == 0
    print(f"stack by other rules: {[(a.name, crashes(a)) for a in rules.arms]}")
    print(f"laps by other rules: {[(a.name, crashes(a)) for a in laps.arms]}")
    print(f"written {args.page}")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
