"""A campaign of a program: its system, its folder, its flights, what they say.

Purpose: `campaign`, what `soter campaign` and `Program.campaign` do.
Non-goals: flying (`campaign/`), printing.
"""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.given import end_of, mistake
from soter.campaign.fleet import Fleet
from soter.campaign.flying import fly
from soter.campaign.result import Result, result_of
from soter.campaign.store import About, Store
from soter.simulate.params import changed
from soter.simulate.settings import seed_value

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.campaign.fleet import Flight
    from soter.program.model.system import System

HOURS_MAX = 1e7
WORKERS_MAX = 256


@dataclass(frozen=True)
class Campaign:
    """What was flown. `folder`: where every flight stands; `wall_s`: of this call alone.

    `flown`: flights of this call; the others stood in the folder.
    """

    system: str
    until_s: float
    first_seed: int
    folder: Path
    flights: tuple[Flight, ...]
    result: Result
    flown: int
    wall_s: float
    workers: int


def campaign(
    flat: System,
    path: str,
    *,
    hours: float | None = None,
    flights: int | None = None,
    until: float | str | None = None,
    seed: int = 1,
    workers: int | None = None,
    output: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Campaign:
    """Fly `flights` seeds, or as many as make `hours` of flight (1 h by default).

    Flight k is the run of seed `seed` + k, so `soter run --seed` flies it again. `workers`:
    threads, one a core by default; the results are the same. `output`: the folder; a campaign of
    the same program, system, time, parameters and seed goes on where it stopped, and may be made
    longer. SoterError U001 for wrong figures, U003 for extern nodes, D006 for the folder.
    """
    began = time.perf_counter()
    until_ns = end_of(flat, until)
    count = _count(hours, flights, until_ns)
    threads = workers if workers is not None else os.cpu_count() or 1
    if not 1 <= threads <= WORKERS_MAX:
        raise mistake("U001", f"{threads} workers cannot fly", f"give 1 to {WORKERS_MAX}")
    about = About(
        program=Path(path).name,
        program_sha256=flat.program.sha256,
        system=flat.name,
        params={name: text for name, (text, _) in changed(flat).items()},
        until_ns=until_ns,
        first_seed=seed_value(seed),
        modules=[m.name for m in flat.modules],
    )
    fleet = Fleet(flat, until_ns)
    folder = Path(output) if output is not None else _folder(path, about)
    store = Store(folder, about)
    before = len(store.flights)
    if before < count:
        fly(fleet, store, count, threads, progress or _quiet)
    wanted = store.flights[:count]
    return Campaign(
        system=flat.name,
        until_s=until_ns / 1e9,
        first_seed=about.first_seed,
        folder=folder,
        flights=tuple(wanted),
        result=result_of(wanted, about.modules),
        flown=max(count - before, 0),
        wall_s=time.perf_counter() - began,
        workers=threads,
    )


def _quiet(_: float) -> None:
    pass


def _count(hours: float | None, flights: int | None, until_ns: int) -> int:
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


def _folder(path: str, about: About) -> Path:
    parts = [Path(path).stem, about.system, f"{about.until_ns / 1e9:g}s", str(about.first_seed)]
    parts += [f"{k}={v}" for k, v in about.params.items()]
    name = re.sub(r"[^A-Za-z0-9_.=+-]", "_", "-".join(parts))[:120]
    return Path(".soter") / f"campaign-{name}"


def figures(found: Campaign) -> dict[str, Any]:
    """The fields of `--json` (docs/json.md)."""
    r = found.result
    return {
        "system": found.system,
        "hours": r.hours,
        "flights": r.flights,
        "flight_s": found.until_s,
        "seed": found.first_seed,
        "violations": r.violations,
        "violations_per_hour": list(r.per_hour),
        "flights_violated": r.flights_violated,
        "violated_per_flight": list(r.per_flight),
        "disengagements": sum(m.disengagements for m in r.modules),
        "episodes": sum(m.episodes for m in r.modules),
        "ac_share": r.ac_share,
        "modules": {
            m.name: {
                "ac_share": m.ac_share,
                "disengagements": m.disengagements,
                "episodes": m.episodes,
                "episodes_per_hour": list(m.per_hour),
                "gate_faults": m.gate_faults,
            }
            for m in r.modules
        },
        "broken": dict(r.broken),
        "violated_flights": [
            {"flight": f.number, "seed": f.seed, "first_s": f.first_s, "what": list(f.broken)}
            for f in r.worst
        ],
        "digest": r.digest,
        "folder": str(found.folder),
        "wall_s": found.wall_s,
        "workers": found.workers,
    }


def settings_of(args: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of `campaign` among those of a command line."""
    names = ("hours", "flights", "until", "seed", "workers", "output")
    return {n: args[n] for n in names}
