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

from soter.diagnostics.diagnostic import Diagnostic, SoterError
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
        raise SoterError((Diagnostic("D006", str(error)),)) from error


@dataclass
class _LoggedValues:
    """What is read of a log, by full name: times in s, and what stood from then on."""

    t: Type
    times_s: list[float] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)


class _Logged:
    """What is read of a log of a system, by full name."""

    def __init__(self, path: Path, system: System) -> None:
        truths = {f"{x.name}.truth": x.plant.truth for x in system.components if x.plant}
        types = {**{t.name: t.type for t in system.topics}, **truths}
        names = [m.name for m in system.modules]
        self.values = {name: _LoggedValues(t) for name, t in types.items()}
        self.modes: dict[str, list[tuple[float, bool]]] = {name: [] for name in names}
        self.saw: dict[str, list[tuple[float, Sequence[bool]]]] = {name: [] for name in names}
        self.end_s = 0.0
        for time_ns, channel, message in messages(path):
            self.end_s = max(self.end_s, time_ns / 1e9)
            if channel == MODES_TOPIC and message["module"] in self.modes:
                self.modes[message["module"]].append((time_ns / 1e9, message["mode"] == "AC"))
            elif channel == DECISIONS_TOPIC and message["module"] in self.saw:
                seen = [bool(message["predicates"].get(name)) for name in PREDICATES]
                self.saw[message["module"]].append((time_ns / 1e9, seen))
            elif channel in self.values:
                read = self.values[channel]
                read.times_s.append(time_ns / 1e9)
                read.values.append(_value(path, system, channel, read.t, message))


def _live(path: Path, system: System, seed: int) -> Live:
    log = _Logged(path, system)
    if not any(read.values for read in log.values.values()):
        raise unreadable(path, f"it holds no topic of `{system.name}`")
    places = {t.name: f"t:{t.name}" for t in system.topics}
    places |= {f"{x.name}.truth": f"c:{x.name}" for x in system.components if x.plant}
    held = {
        places[name]: HeldValues(read.t, np.array(read.times_s), read.values)
        for name, read in log.values.items()
        if read.values
    }
    control = tuple(
        control_of(system, m, log.modes[m.name] or [(0.0, False)], log.saw[m.name])
        for m in system.modules
    )
    return Live(log.end_s, values_of(system, held), steps_of(system, seed, log.end_s, {}), control)


def _value(path: Path, system: System, channel: str, t: Type, message: Any) -> Value:  # noqa: ANN401
    given = message if isinstance(t, RecordType) else message.get("value")
    try:
        return from_json(t, given, channel)
    except ValueShapeError as error:
        raise unreadable(path, f"{error}; is it a log of `{system.name}`?") from error
