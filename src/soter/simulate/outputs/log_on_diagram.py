"""The log of a run on the diagram of its system: one page that replays it.

Purpose: `log_page`: what `soter show FILE --log LOG` writes.
Non-goals: logs that `soter run --log` did not write; time lines (`soter run --report`). A log does
not tell when a component latched: it goes on lighting up by its calendar.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagram.svg import picture
from soter.report.atomic_write import ReportError
from soter.report.html import write_replay
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC
from soter.report.mcap_reading import messages, metadata, require_log_package, unreadable
from soter.report.run.live_diagram import Live
from soter.report.run.record import Picture
from soter.simulate.outputs.run_on_diagram import SAW, HeldValues, control_of, steps_of, values_of
from soter.simulate.trace_to_recorded_run import logged_value

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import System
    from soter.language.model.types import Type, Value

PREDICATES = [name.replace("saw_", "") for name, _ in SAW]


def write_log_page(log: str | Path, system: System, path: str | Path) -> Path:
    """Write the page on which a log of this system is replayed; SoterError D006, D007."""
    require_log_package()
    source = Path(log)
    said = metadata(source)
    live = _live(source, system, int(said.get("seed") or 0))
    facts = [f"log {source.name}", *(f"{k} {said[k]}" for k in ("system", "seed") if k in said)]
    told = ", ".join(facts)
    if said.get("program_sha256") != system.program.sha256:
        told += ". The program was changed since: what is drawn is how it stands now."
    title = f"System {system.name}"
    try:
        return write_replay(title, told, Picture(picture(system, live=True), live), path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


@dataclass
class _LoggedValues:
    """What is read of a log, by full name: times in s, and what stood from then on."""

    t: Type
    times_s: list[float] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)


def _read(
    path: Path,
    system: System,
    known: Mapping[str, _LoggedValues],
    modes: Mapping[str, list[tuple[float, bool]]],
    saw: Mapping[str, list[tuple[float, Sequence[bool]]]],
) -> float:
    """Fill values, modes and what DMs saw from a log; its end in s."""
    end_s = 0.0
    for time_ns, channel, message in messages(path):
        end_s = max(end_s, time_ns / 1e9)
        if channel == MODES_TOPIC and message["module"] in modes:
            modes[message["module"]].append((time_ns / 1e9, message["mode"] == "AC"))
        elif channel == DECISIONS_TOPIC and message["module"] in saw:
            seen = [bool(message["predicates"].get(name)) for name in PREDICATES]
            saw[message["module"]].append((time_ns / 1e9, seen))
        elif channel in known:
            read = known[channel]
            read.times_s.append(time_ns / 1e9)
            read.values.append(logged_value(path, system, channel, read.t, message))
    return end_s


def _live(path: Path, system: System, seed: int) -> Live:
    known = {t.name: _LoggedValues(t.type) for t in system.topics}
    plants = {x.name: x.plant for x in system.components if x.plant is not None}
    known |= {f"{name}.truth": _LoggedValues(plant.truth) for name, plant in plants.items()}
    modes: dict[str, list[tuple[float, bool]]] = {m.name: [] for m in system.modules}
    saw: dict[str, list[tuple[float, Sequence[bool]]]] = {m.name: [] for m in system.modules}
    end_s = _read(path, system, known, modes, saw)
    if not any(read.values for read in known.values()):
        raise unreadable(path, f"it holds no topic of `{system.name}`")
    held = {
        at: HeldValues(known[name].t, np.array(known[name].times_s), known[name].values)
        for at, name in (
            *((f"t:{t.name}", t.name) for t in system.topics),
            *((f"c:{name}", f"{name}.truth") for name in plants),
        )
        if known[name].values
    }
    control = tuple(
        control_of(system, m, modes[m.name] or [(0.0, False)], saw[m.name]) for m in system.modules
    )
    return Live(end_s, values_of(system, held), steps_of(system, seed, end_s, {}), control)
