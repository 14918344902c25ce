"""The log of a run on the diagram of its system: one page that replays it.

Purpose: `log_page`: what `soter show FILE --log LOG` writes.
Non-goals: logs that `soter run --log` did not write; time lines (`soter run --report`). A log does
not tell when a component latched: it goes on lighting up by its calendar.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import mistake
from soter.diagram.svg import picture
from soter.language.model.types import RecordType
from soter.language.model.values import ValueShapeError, from_json
from soter.report.atomic_write import ReportError
from soter.report.html import write_replay
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC
from soter.report.mcap_reading import messages, metadata, require_log_package, unreadable
from soter.report.run.live_diagram import Live
from soter.report.run.record import Picture
from soter.simulate.outputs.run_on_diagram import SAW, HeldValues, control_of, steps_of, values_of

if TYPE_CHECKING:
    from collections.abc import Sequence

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
        raise mistake("D006", str(error)) from error


@dataclass
class _LoggedValues:
    """What is read of a log, by full name: times in s, and what stood from then on."""

    t: Type
    times_s: list[float] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)


class _Log:
    """What a log says of a system: values, who had control, what decision modules saw."""

    def __init__(self, system: System) -> None:
        self.system, self.end_s = system, 0.0
        self.known = {t.name: _LoggedValues(t.type) for t in system.topics}
        for x in system.components:
            if x.plant is not None:
                self.known[f"{x.name}.truth"] = _LoggedValues(x.plant.truth)
        names = [m.name for m in system.modules]
        self.modes: dict[str, list[tuple[float, bool]]] = {n: [] for n in names}
        self.saw: dict[str, list[tuple[float, Sequence[bool]]]] = {n: [] for n in names}

    def see(self, path: Path, time_s: float, channel: str, message: Any) -> None:  # noqa: ANN401
        """One message."""
        if channel == MODES_TOPIC and message["module"] in self.modes:
            self.modes[message["module"]].append((time_s, message["mode"] == "AC"))
        elif channel == DECISIONS_TOPIC and message["module"] in self.saw:
            seen = [bool(message["predicates"].get(name)) for name in PREDICATES]
            self.saw[message["module"]].append((time_s, seen))
        elif channel in self.known:
            read = self.known[channel]
            read.times_s.append(time_s)
            read.values.append(_value(path, self.system, channel, read.t, message))


def _live(path: Path, system: System, seed: int) -> Live:
    plants = [x for x in system.components if x.plant is not None]
    log = _Log(system)
    for time_ns, channel, message in messages(path):
        log.end_s = max(log.end_s, time_ns / 1e9)
        log.see(path, time_ns / 1e9, channel, message)
    known, modes, saw, end_s = log.known, log.modes, log.saw, log.end_s
    if not any(read.values for read in known.values()):
        raise unreadable(path, f"it holds no topic of `{system.name}`")
    held = {
        at: HeldValues(known[name].t, np.array(known[name].times_s), known[name].values)
        for at, name in (
            *((f"t:{t.name}", t.name) for t in system.topics),
            *((f"c:{x.name}", f"{x.name}.truth") for x in plants),
        )
        if known[name].values
    }
    control = tuple(
        control_of(system, m, modes[m.name] or [(0.0, False)], saw[m.name]) for m in system.modules
    )
    return Live(end_s, values_of(system, held), steps_of(system, seed, end_s, {}), control)


def _value(path: Path, system: System, channel: str, t: Type, message: Any) -> Value:  # noqa: ANN401
    given = message if isinstance(t, RecordType) else message.get("value")
    try:
        return from_json(t, given, channel)
    except ValueShapeError as error:
        raise unreadable(path, f"{error}; is it a log of `{system.name}`?") from error
