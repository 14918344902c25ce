"""What the diagram of a system shows while a run is replayed, and the page that replays a log.

Purpose: `replay_rows` reads values, steps, modes and what decision modules saw off a trace, for
`report/run/live_diagram.py`. `write_log_page` writes the page of `soter show FILE --log LOG`.
Non-goals: the page; logs that `soter run --log` did not write; time lines (`soter run --report`). A
log does not tell when a component latched: it goes on lighting up by its calendar.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from soter.core.layout import group_field
from soter.diagram.svg import picture
from soter.diagram.system_graph import live_rows, saw_key
from soter.language.model.types import ArrayType, RecordType
from soter.report.html import write_replay
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC
from soter.report.mcap_reading import messages, metadata, require_log_package, unreadable
from soter.report.run.live_diagram import STEPS_MAX, Control, Live, Steps, Values
from soter.report.run.record import Picture
from soter.semantics.faults import group_by_component, next_release
from soter.simulate.run_log import logged_value

T = TypeVar("T")

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import numpy.typing as npt

    from soter.language.model.system import Module, System
    from soter.language.model.types import Type, Value
    from soter.simulate.result import Run


SAW = (("ttf", "ttf"), ("safer", "safer"), ("stale", "stale"), ("saw_gate_fault", "gate fault"))
"""What a decision module can see, as fields of a state, with words."""


@dataclass(frozen=True)
class HeldValues:
    """What a topic or a plant held from `time_s` (n,) on: n `values` of type `t`.

    They are records of a trace, or a list of values.
    """

    t: Type
    time_s: npt.NDArray[np.float64]
    values: npt.NDArray[Any] | list[Value]


def replay_rows(run: Run, trace: npt.NDArray[Any]) -> Live:
    """The rows of a run's states `trace`, (n,), all of them or thinned."""
    system = run.system
    time_s = trace["header"]["ct"] / 1e9
    held = {
        f"t:{topic.name}": HeldValues(topic.type, time_s, trace["topics"][topic.name])
        for topic in system.topics
    }
    for group in run.layout.groups:
        component = system.components[group.owner] if group.owner >= 0 else None
        if component is not None and component.plant is not None:
            held[f"c:{component.name}"] = HeldValues(
                component.plant.truth, time_s, trace[group_field(group)]
            )
    latched = {
        component.name: int(trace["header"]["ct"][int(np.argmax(column))])
        for component in system.components
        if (column := trace["components"]["latched"][:, component.index] != 0).any()
    }
    end_s = float(time_s[-1]) if len(time_s) else 0.0
    return Live(
        end_s,
        value_rows(system, held),
        step_rows(system, run.seed, end_s, latched),
        tuple(
            _control_of_trace(system, module, time_s, trace["modules"][:, module.index])
            for module in system.modules
        ),
    )


def value_rows(system: System, held: Mapping[str, HeldValues]) -> tuple[Values, ...]:
    """The rows of everything that is held, by `t:TOPIC` and `c:PLANT`."""
    return tuple(
        Values(
            row.key,
            row.label,
            row.names,
            held[name].time_s,
            tuple(_column(held[name], path) for path in row.paths),
            row.unit,
            row.words,
        )
        for name, rows in live_rows(system).items()
        if name in held
        for row in rows
        if row.paths
    )


def step_rows(
    system: System, seed: int, end_s: float, latched: Mapping[str, int]
) -> tuple[Steps, ...]:
    """When each component steps: by its calendar, or, where faults move it, by its releases."""
    late, end_ns = group_by_component(system, of_time=True), round(end_s * 1e9)
    calendars = []
    for component in system.components:
        times: list[int] | None = None
        if component.index in late:
            times, now = [], -1
            while len(times) < STEPS_MAX:
                now = next_release(system, late[component.index], component, seed, now)
                if now > end_ns:
                    break
                times.append(now)
        step_times = None if times is None else tuple(times)
        calendars.append(
            Steps(
                component.name,
                component.period_ns,
                component.phase_ns,
                step_times,
                latched.get(component.name),
            )
        )
    return tuple(calendars)


def control_rows(
    system: System,
    module: Module,
    modes: Iterable[tuple[float, bool]],
    saw: Iterable[tuple[float, Sequence[bool]]],
) -> Control:
    """Who had control, and what the DM `saw` (`SAW`): (time in s, value), all or the changes."""
    names = [word for _, word in SAW]
    seen_words = (
        (t, " ".join(n for n, on in zip(names, row, strict=True) if on)) for t, row in saw
    )
    return Control(
        module.name,
        system.components[module.ac].name,
        system.components[module.sc].name,
        tuple(_changes(modes)),
        saw_key(module.name),
        tuple(_changes((t, text or "no ttf") for t, text in seen_words)),
    )


def _control_of_trace(
    system: System, m: Module, time_s: npt.NDArray[Any], own: npt.NDArray[Any]
) -> Control:
    modes = zip(time_s.tolist(), (own["mode"] == 1).tolist(), strict=True)
    seen = zip(*((own[name] != 0).tolist() for name, _ in SAW), strict=True)
    return control_rows(system, m, modes, zip(time_s.tolist(), seen, strict=True))


def _changes(told: Iterable[tuple[float, T]]) -> Iterable[tuple[float, T]]:
    """The items whose value differs from the one before."""
    before: list[T] = []
    for t, value in told:
        if before != [value]:
            yield t, value
        before = [value]


def _column(held: HeldValues, path: Sequence[int]) -> npt.NDArray[np.float64]:
    """The numbers, (n,), at a path of each of n values."""
    if isinstance(held.values, list):
        return np.array([reduce(getitem, path, v) for v in held.values], dtype=np.float64)
    values, t = held.values, held.t
    for i in path:
        if isinstance(t, RecordType):
            name, t = t.fields[i]
            values = values[name]
        else:
            assert isinstance(t, ArrayType)
            values, t = values[:, i], t.element
    return np.ascontiguousarray(values, dtype=np.float64)


PREDICATES = [name.replace("saw_", "") for name, _ in SAW]


def write_log_page(log: str | Path, system: System, path: str | Path) -> Path:
    """Writes the page on which a log of this system is replayed; `SoterError` D006, D007."""
    require_log_package()
    source = Path(log)
    facts_of_log = metadata(source)
    live = _live_diagram(source, system, int(facts_of_log.get("seed") or 0))
    facts = [
        f"log {source.name}",
        *(f"{k} {facts_of_log[k]}" for k in ("system", "seed") if k in facts_of_log),
    ]
    subtitle = ", ".join(facts)
    if facts_of_log.get("program_sha256") != system.program.sha256:
        subtitle += ". The program was changed since: what is drawn is how it stands now."
    title = f"System {system.name}"
    return write_replay(title, subtitle, Picture(picture(system, live=True), live), path)


@dataclass
class _LoggedValues:
    """The values read of a log: times in s, and what stood from each on."""

    t: Type
    times_s: list[float] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)


def _read_channels(
    path: Path,
    system: System,
    known: Mapping[str, _LoggedValues],
    modes: Mapping[str, list[tuple[float, bool]]],
    saw: Mapping[str, list[tuple[float, Sequence[bool]]]],
) -> float:
    """Fills in values, modes and what DMs saw from a log; returns its end in s."""
    end_s = 0.0
    for time_ns, channel, message in messages(path):
        end_s = max(end_s, time_ns / 1e9)
        if channel == MODES_TOPIC and message["module"] in modes:
            modes[message["module"]].append((time_ns / 1e9, message["mode"] == "AC"))
        elif channel == DECISIONS_TOPIC and message["module"] in saw:
            seen = [bool(message["predicates"].get(name)) for name in PREDICATES]
            saw[message["module"]].append((time_ns / 1e9, seen))
        elif channel in known:
            logged = known[channel]
            logged.times_s.append(time_ns / 1e9)
            logged.values.append(logged_value(path, system, channel, logged.t, message))
    return end_s


def _live_diagram(path: Path, system: System, seed: int) -> Live:
    known = {t.name: _LoggedValues(t.type) for t in system.topics}
    plants = {x.name: x.plant for x in system.components if x.plant is not None}
    known |= {f"{name}.truth": _LoggedValues(plant.truth) for name, plant in plants.items()}
    modes: dict[str, list[tuple[float, bool]]] = {m.name: [] for m in system.modules}
    saw: dict[str, list[tuple[float, Sequence[bool]]]] = {m.name: [] for m in system.modules}
    end_s = _read_channels(path, system, known, modes, saw)
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
        control_rows(system, m, modes[m.name] or [(0.0, False)], saw[m.name])
        for m in system.modules
    )
    return Live(end_s, value_rows(system, held), step_rows(system, seed, end_s, {}), control)
