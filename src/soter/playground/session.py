"""The functions of Soter that the page calls, with JSON texts in and out.

Purpose: `check`, `layout`, `explain` of a program, and `PlaygroundSession`, a run of the reference
interpreter that goes on piece by piece, so that the page can draw it meanwhile: every number of
every topic and every true state is a signal with unit, panel and limits. Needs neither NumPy nor
cffi nor a compiler: it runs in Pyodide as it does here.
Non-goals: proofs, compiled code, externs in Python or C; the page says so. Drawing.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.codes import explain as page_of
from soter.diagnostics.codes import known_code, similar_codes
from soter.diagnostics.diagnostic import Diagnostics, SoterError, Source, mistake
from soter.diagnostics.render import render_all, to_json
from soter.diagram.svg import picture
from soter.language.evaluate.topic_ranges import signal_limits
from soter.language.front_end import CheckResult, check_file, system_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    IntType,
    RecordType,
    Type,
    show_ns,
)
from soter.language.syntax.printer import format_source
from soter.semantics.configuration import AC, Configuration
from soter.semantics.externs import UnboundExternError
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_instant

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import System


SIGNALS_MAX = 16
ELEMENTS_MAX = 4


@dataclass(frozen=True)
class Signal:
    """A number over time, in a topic or (`plant`) in the true state of a component, by `index`."""

    name: str
    unit: str
    plant: bool
    index: int
    path: tuple[int, ...]

    def value_in(self, c: Configuration) -> float:
        """The value of the signal in a configuration."""
        value = c.L[self.index] if self.plant else c.Topics[self.index]
        for i in self.path:
            value = value[i]
        return float(value)

    def about(self) -> dict[str, object]:
        """The signal's name and unit, as JSON for the page."""
        return {"name": self.name, "unit": self.unit}


def system_signals(system: System) -> list[Signal]:
    """The signals of a system: true states first, then topics; at most `SIGNALS_MAX`."""
    signals: list[Signal] = []
    for c in system.components:
        if c.plant is not None:
            for i, v in enumerate(c.plant.states):
                for name, unit, path in _numbers_in_type(f"{c.name}.{v.name}", v.type):
                    signals.append(Signal(name, unit, plant=True, index=c.index, path=(i, *path)))
    for t in system.topics:
        if t.queue_of is None and not t.held:
            for name, unit, path in _numbers_in_type(t.name, t.type):
                signals.append(Signal(name, unit, plant=False, index=t.index, path=path))
    return signals[:SIGNALS_MAX]


def _numbers_in_type(
    name: str, t: Type, path: tuple[int, ...] = ()
) -> Iterator[tuple[str, str, tuple[int, ...]]]:
    """Yields name, unit and path of each number in a type, except in long arrays and lists."""
    if isinstance(t, (FloatType, IntType)):
        yield name, t.unit, path
    elif isinstance(t, BoolType):
        yield name, "", path
    elif isinstance(t, RecordType):
        for i, (n, f) in enumerate(t.fields):
            yield from _numbers_in_type(f"{name}.{n}", f, (*path, i))
    elif isinstance(t, ArrayType) and t.size <= ELEMENTS_MAX:
        for i in range(t.size):
            yield from _numbers_in_type(f"{name}[{i}]", t.element, (*path, i))


UNTIL_NS = 10 * 10**9
"""How long systems run that say no `until`."""
SAMPLES_MAX = 1500
"""How many points of a run the page draws; changes of mode are added to them."""
CLOCK_EVERY = 16
"""How many instants pass between two readings of the clock."""


def check(path: str, text: str) -> str:
    """JSON on a program: whether it is well-formed, diagnostics, systems and a picture."""
    checked = check_file(path, text)
    reply: dict[str, object] = {
        "ok": checked.ok,
        "text": render_all(checked.diagnostics.items),
        "diagnostics": [to_json(d) for d in checked.diagnostics.items],
        "systems": list(checked.systems) if checked.ok else [],
    }
    if checked.ok:
        reply |= _default_picture(checked)
    return json.dumps(reply)


def _default_picture(checked: CheckResult) -> dict[str, object]:
    """The name and the picture of the default system, or else of the first system."""
    symbol = checked.default_system()
    name = symbol.name if symbol is not None else next(iter(checked.systems), None)
    if name is None:
        return {"default": None, "svg": ""}
    return {"default": name, "svg": picture(system_of(checked, name))}


def layout(path: str, text: str) -> str:
    """JSON with the program in standard layout, or unchanged with diagnostics of its errors."""
    diagnostics = Diagnostics()
    done = format_source(Source(path, text), diagnostics)
    shown = render_all(diagnostics.items)
    return json.dumps(
        {"ok": done is not None, "program": text if done is None else done, "text": shown}
    )


def explain(code: str) -> str:
    """JSON with the page of a diagnostic code, or with similar codes."""
    page = page_of(code)
    near = similar_codes(code)
    if page is None:
        page = f"There is no code `{code[:40]}`." + (
            f" Did you mean {', '.join(near)}?" if near else ""
        )
    return json.dumps({"code": known_code(code), "page": page})


class PlaygroundSession:
    """A run of one system from its start; `about` and `advance` give JSON.

    Raises `SoterError` if the program has errors, or externs that cannot be answered here.
    """

    def __init__(self, path: str, text: str, system: str = "", seed: int = 1) -> None:
        self.system: System = system_of(check_file(path, text), system or None)
        try:
            self.interpreter = Interpreter(self.system, seed)
        except UnboundExternError as error:
            raise unanswered_error(error) from error
        self.until_ns = self.system.until_ns or UNTIL_NS
        self.signals = system_signals(self.system)
        self.limits = signal_limits(self.system)
        self._configuration = self.interpreter.initial()
        self._record = self.interpreter.record()
        self._modes = [m.mode for m in self._record.modules]
        self._step_ns = max(self.until_ns // SAMPLES_MAX, 1)
        self._sampled_ns = -self._step_ns
        self._is_reported = [False] * len(self._record.properties)

    def about(self) -> str:
        """JSON about what the page is going to draw."""
        notes = [
            f"{m.name} leaves `ttf` or `safer` to be computed, which needs a compiler: AC never "
            "gets control here"
            for m in self.system.modules
            if m.symbol.ttf is None or m.symbol.safer is None
        ]
        return json.dumps(
            {
                "system": self.system.name,
                "until_s": self.until_ns / 1e9,
                "until": show_ns(self.until_ns),
                "signals": [
                    {
                        **s.about(),
                        "limits": sorted({x.value for x in self.limits if x.signal == s.name}),
                    }
                    for s in self.signals
                ],
                "modules": [
                    {
                        "name": m.name,
                        "ac": self.system.components[m.ac].name,
                        "sc": self.system.components[m.sc].name,
                    }
                    for m in self.system.modules
                ],
                "notes": notes,
            }
        )

    def advance(self, budget_s: float) -> str:
        """Runs for about `budget_s` s; gives JSON: samples, mode changes, violations."""
        deadline = time.perf_counter() + budget_s
        rows: list[list[object]] = []
        events: list[dict[str, object]] = []
        machine, done, count = self.interpreter.machine, False, 0
        while True:
            if next_instant(machine, self._configuration) > self.until_ns:
                done = True
                if self._sampled_ns != self._configuration.ct:
                    rows.append(self._sample_row())
                break
            self._configuration = self.interpreter.instant(self._configuration, record=self._record)
            changed = self._note_changes(events)
            now = self._configuration.ct
            if changed or now >= self._sampled_ns + self._step_ns:
                self._sampled_ns = now
                rows.append(self._sample_row())
            count += 1
            if count % CLOCK_EVERY == 0 and time.perf_counter() >= deadline:
                break
        return json.dumps(
            {
                "done": done,
                "time_s": max(self._configuration.ct, 0) / 1e9,
                "rows": rows,
                "events": events,
                "violations": self._record.violations,
            }
        )

    def _sample_row(self) -> list[object]:
        """A row of samples: the time in s, the modes (1: AC), the signals."""
        c = self._configuration
        values = [s.value_in(c) for s in self.signals]
        finite = [v if math.isfinite(v) else None for v in values]
        return [c.ct / 1e9, [int(m == AC) for m in self._modes], finite]

    def _note_changes(self, events: list[dict[str, object]]) -> bool:
        """Adds mode changes and new violations to `events`; True if a mode changed."""
        now = [m.mode for m in self._record.modules]
        time_s = self._configuration.ct / 1e9
        changed = now != self._modes
        if changed:
            for index, (before, after) in enumerate(zip(self._modes, now, strict=True)):
                if before != after:
                    module = self._record.modules[index]
                    why = [w for w in ("ttf", "stale", "gate_fault") if getattr(module, w)]
                    events.append(
                        {
                            "time_s": time_s,
                            "what": f"{self.system.modules[index].name}: "
                            + ("SC → AC" if after == AC else "AC → SC"),
                            "why": "safer" if after == AC else " and ".join(why),
                            "bad": False,
                        }
                    )
            self._modes = now
        for i, p in enumerate(self._record.properties):
            if p.count and not self._is_reported[i]:
                self._is_reported[i] = True
                text = self.system.properties[i].text
                events.append({"time_s": time_s, "what": text, "why": "violated", "bad": True})
        return changed


def start(path: str, text: str, system: str = "", seed: int = 1) -> PlaygroundSession | str:
    """A new session; or, if the program cannot run, the text of the diagnostics."""
    try:
        return PlaygroundSession(path, text, system, seed)
    except SoterError as error:
        return render_all(error.diagnostics)


def unanswered_error(error: UnboundExternError) -> SoterError:
    """The error X001 for a program with externs, which the page cannot call."""
    note = "externs in Python and C run on your machine: `pip install`, then `soter run`"
    return mistake("X001", str(error), notes=(note,))
