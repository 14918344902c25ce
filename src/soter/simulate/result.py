"""The result of a run: its final state, its trace, its violations, its notes.

Purpose: a `Run` gives the final state and, if a trace was kept, violations, modules, topics, truths
and plain arrays; its notes point at results that look fine and probably are not.
Non-goals: running (`run.py`), decoding single values (`run_fields.py`), drawing.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.core.layout import ac_share, field_name_of_group
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.types import ArrayType, RecordType, has_list
from soter.semantics.run_record import NAN_LOOKS_MAX
from soter.simulate.decisions import DecisionStepRecord, change_records, margins_s
from soter.simulate.run_observer import moved_rows, plain_numbers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy as np
    import numpy.typing as npt

    from soter.core.layout import StateLayout
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.proof_verdicts import Proof
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type, Value
    from soter.simulate.externs.python_answers import Tally
    from soter.simulate.module_safe_check import SafeLooks
    from soter.simulate.run_observer import FirstFault, ModeChange

TOGETHER_MIN = 4
"""A note is given if ttf and safer held together in at least this many decisions."""


@dataclass(frozen=True)
class Violation:
    """A violated property, or a component that a step fault has latched.

    `time_s`: the time of the first violation; `count`: how often a violation began; `span`: the
    place of the property or of the component's declaration.
    """

    what: str
    kind: str
    time_s: float | None
    count: int
    span: Span | None = None


@dataclass(frozen=True)
class ModuleSummary:
    """The figures of one module in a run. `ac_share` is the share of time in mode AC.

    `looks`: the looks of its DM with fresh reads. `outside`: after how many of these its own `safe`
    was false on its topics; None if that was not judged (a run that was neither hashed nor traced,
    or a `safe` that calls an extern function).
    """

    ac_share: float
    switches_to_sc: int
    switches_to_ac: int
    gate_faults: int
    looks: int = 0
    outside: int | None = None
    first_outside_s: float | None = None
    nan_looks: int = 0
    """How many DM steps compared a NaN in `ttf` or `safer`; 65,535 means that many or more."""


@dataclass(eq=False, repr=False, kw_only=True)
class Run:
    """The result of a run, which docs/python.md describes.

    `trace` has one record per instant (dtype `state_dtype`), or is None. If only some parts were
    `recorded`, the records have only those.

    `duration_s` is the requested length, `reached_s` the time of the last instant; they differ if
    the run was `interrupted`. `changes` and `first_faults` are filled if the run was hashed or
    traced.
    """

    system: System
    layout: StateLayout
    dtype: np.dtype[Any]
    seed: int
    engine: str
    final: Any
    trace: npt.NDArray[Any] | None
    instants: int
    duration_s: float
    wall_s: float
    trace_sha256: str | None
    recorded: tuple[str, ...] | None = None
    """The topics, truths and modules that the trace was to keep; None: everything, or no trace."""
    extern_failures: dict[str, str] = field(default_factory=dict)
    """First failure of each extern that had one."""
    changes: list[ModeChange] = field(default_factory=list)
    first_faults: dict[int, FirstFault] = field(default_factory=dict)
    interrupted: bool = False
    lag_s_max: float | None = None
    """The greatest lateness of an instant in s, if the run was paced by the clock; else None."""
    timing: dict[str, Any] | None = None
    """What the real-time driver reported (docs/json.md); None: virtual time."""
    paced: str = ""
    """Why a run that was to be in real time was only paced by the clock; "" if it was not."""
    externs: dict[str, str] = field(default_factory=dict)
    """What answered each extern, in words."""
    extern_files: dict[str, dict[str, str]] = field(default_factory=dict)
    """The SHA-256 of the files behind each extern: weights of a policy, what C includes."""
    computed: list[str] = field(default_factory=list)
    """A note on each module whose `ttf` and `safer` were computed."""
    proofs: dict[str, Proof] = field(default_factory=dict)
    """What `soter verify` proved of the modules of exactly this system, where that is known."""
    extern_tallies: dict[str, Tally] = field(default_factory=dict)
    """Steps of each extern that Python answered, and those in which it published nothing."""
    decided: list[tuple[int, int]] = field(default_factory=list)
    """By module: DM steps, and those in which ttf and safer held both (hashed or traced runs)."""
    moved_commands: list[tuple[int, int]] = field(default_factory=list)
    """By module with a shield `toward sc`: commands that AC published in control, and those of
    them that were moved (hashed or traced runs); else zeros."""
    safe_looks: list[SafeLooks] = field(default_factory=list)
    """By module: after how many looks of its DM `safe` was false (hashed or traced runs)."""
    cut: str = ""
    """Why its recording was not read to its end; "" if it was, and in virtual time."""
    misses_recorded: int = 0
    """How often the trusted part was late in a recorded flight."""
    page: Callable[[Run], str] | None = field(default=None, repr=False, compare=False)
    """A function that makes the report as one HTML text for notebooks, "" if it cannot."""

    def __repr__(self) -> str:
        count = f"{self.violations} violation{'' if self.violations == 1 else 's'}"
        stopped = f" of {self.duration_s:g} s, interrupted" if self.interrupted else ""
        time_s = self.reached_s if self.interrupted else self.duration_s
        dead = "".join(f", {n} never answered" for n in self.never_answered)
        run = f"{self.system.name} seed {self.seed}: {time_s:g} s{stopped}"
        return f"<soter.Run {run}, {count}{dead}>"

    @property
    def never_answered(self) -> dict[str, int]:
        """Maps each extern that failed in every step to the number of its steps."""
        faults = self._fault_counts
        return {
            name: tally.steps
            for name, tally in self.extern_tallies.items()
            if tally.steps and faults[name] == tally.steps
        }

    @property
    def late(self) -> bool:
        """Whether the trusted part of a real-time run was late more often than allowed."""
        timing = self.timing
        return timing is not None and bool(timing["misses"] > timing["misses_allowed"])

    @property
    def failures(self) -> list[str]:
        """A sentence for each extern that failed, on its first failure."""
        often = {n: "once" if k == 1 else f"{k:,} times" for n, k in self._fault_counts.items()}
        for name, steps in self.never_answered.items():
            often[name] = f"in every step ({steps:,}), nothing of it was tried"
        return [f"{n} failed {often.get(n, '')}: {why}" for n, why in self.extern_failures.items()]

    @property
    def _fault_counts(self) -> Counter[str]:
        """The number of step faults of each component, by its name."""
        rows = self.final["components"]
        return Counter({x.name: int(rows[x.index]["faults"]) for x in self.system.components})

    def _repr_html_(self) -> str:
        from soter.report.tables import framed_document, notebook_table  # noqa: PLC0415 - in notebooks only

        rows = [
            (n, f"{m.ac_share:.1%}", m.switches_to_ac, m.switches_to_sc, m.gate_faults)
            for n, m in self.modules.items()
        ]
        heads = ("module", "AC share", "SC to AC", "AC to SC", "gate faults")
        broken = [f"{v.what} at {v.time_s} s" for v in self.violation_list]
        html = notebook_table(repr(self)[1:-1], heads, rows, [*broken, *self.failures, *self.notes])
        page = self.page(self) if self.page is not None else ""
        return html + framed_document(page) if page else html

    @property
    def notes(self) -> list[str]:
        """Sentences on facts about this run that a user should know."""
        return _run_notes(self)

    @property
    def params(self) -> dict[str, Value]:
        """The value of every parameter in this run, by full name; durations are in ns."""
        return dict(self.system.params)

    @property
    def reached_s(self) -> float:
        """The time of the last instant in s."""
        return max(int(self.final["header"]["ct"]), 0) / 1e9

    @property
    def violations(self) -> int:
        """The number of violations."""
        return int(self.final["header"]["violations"])

    @property
    def violation_list(self) -> list[Violation]:
        """All violated properties and latched components."""
        violations = []
        for prop in self.system.properties:
            row = self.final["properties"][prop.index]
            if row["count"]:
                first_s = int(row["first_ns"]) / 1e9
                text = f"{prop.kind} {prop.text}"
                violations.append(
                    Violation(text, "property", first_s, int(row["count"]), prop.span)
                )
        for component in self.system.components:
            row = self.final["components"][component.index]
            if row["latched"]:
                kind = FaultKind(int(row["last_fault"])).name.lower()
                first = self.first_faults.get(component.index)
                violations.append(
                    Violation(
                        f"{component.role} {component.name}: step fault `{kind}`",
                        "fault",
                        None if first is None else first.time_ns / 1e9,
                        1,
                        _declaration_place(component),
                    )
                )
        return violations

    @property
    def modules(self) -> dict[str, ModuleSummary]:
        """Maps each module to its share of time in AC and its switches."""
        summary_by_module = {}
        for module in self.system.modules:
            row = self.final["modules"][module.index]
            share = ac_share(self.final, module.index)
            counts = int(row["to_sc"]), int(row["to_ac"]), int(row["gate_faults"])
            safe_looks = self.safe_looks[module.index] if self.safe_looks else None
            judged = (
                (0, None, None)
                if safe_looks is None
                else (safe_looks.looks, safe_looks.outside, safe_looks.first_outside_s)
            )
            nan_looks = int(row["nan_looks"])
            summary_by_module[module.name] = ModuleSummary(share, *counts, *judged, nan_looks)
        return summary_by_module

    @property
    def decisions(self) -> list[DecisionStepRecord]:
        """The DM steps that changed a mode, in order of time, and why (hashed or traced runs).

        Each has `time_ns`, `module`, `before`, `after`, `reason`, `words` and `why`, which
        docs/python.md describes.
        """
        return change_records(self.system, self.layout, self.changes)

    # Everything below needs a trace: SoterError U001 without one, or for an unknown name.

    def require_trace(self) -> npt.NDArray[Any]:
        """The trace, (instants,); raises SoterError U001 unless all of it was kept."""
        trace = _kept_trace(self)
        if self.recorded is not None:
            message = f"this run recorded only {', '.join(f'`{n}`' for n in self.recorded)}"
            raise mistake("U001", message, "ask for everything: simulate(trace=True)")
        return trace

    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the instants in s, (n,)."""
        return _kept_trace(self)["header"]["ct"] / 1e9

    def topic(self, name: str) -> npt.NDArray[Any]:
        """Values of a topic, or of `<plant>.truth`, by instant, (n,); records have fields."""
        return _trace_values(self, name)[1]

    def truth(self, plant: str) -> npt.NDArray[Any]:
        """True state of a plant after every instant, (n,), a field for each state."""
        return self.topic(f"{plant}.truth")

    def mode(self, module: str) -> npt.NDArray[np.uint8]:
        """Mode of a module after every instant, (n,): 1 is AC, 0 is SC."""
        return _module_mode(self, module)

    def margin(self, module: str) -> npt.NDArray[np.float64]:
        """How long AC surely keeps control, after every instant, (n,), in s: `margin(M)`.

        Raises SoterError U001 if the trace has only parts.
        """
        return margins_s(self.system, *self._traced_module(module))

    def moved(self, module: str) -> npt.NDArray[np.bool_]:
        """Whether a shield `toward sc` moved the command that AC published, at each instant, (n,).

        The command before the move is in the topic `<module>.proposed`. Raises SoterError U001 if
        the trace has only parts.
        """
        return moved_rows(self.system, *self._traced_module(module))[1]

    def _traced_module(self, name: str) -> tuple[Module, npt.NDArray[Any]]:
        trace = self.require_trace()
        self.mode(name)  # SoterError U001 for an unknown module
        return next(m for m in self.system.modules if m.name == name), trace

    def array(self, path: str) -> npt.NDArray[np.float64]:
        """A topic, a truth, or a part of these (`boat.truth.p`) as plain floats.

        (n,) for a number, (n, k) for records and arrays of k numbers, in declared order.
        """
        return _trace_array(self, path)


def _declaration_place(x: Component) -> Span:
    """The place at which a component's node or plant is declared, not where a system uses it."""
    declared = x.node or x.plant
    return declared.span if declared is not None else x.span


# ---------------------------------------------------------------- what a trace holds


def _kept_trace(run: Run, name: str = "") -> npt.NDArray[Any]:
    """The part of the trace that was kept, (n,); `SoterError` U001 if `name` is not in it."""
    if run.trace is None:
        raise mistake("U001", "this run kept no trace", "ask for it: simulate(trace=True)")
    if name and run.recorded is not None and name not in run.recorded:
        help_ = f'name it, too: simulate(trace=["{name}", ...])'
        raise mistake("U001", f"this run did not record `{name}`", help_)
    return run.trace


def _trace_values(run: Run, name: str) -> tuple[Type, npt.NDArray[Any]]:
    """The type and values, (n,), of a topic or a plant's truth; raises SoterError U001."""
    _kept_trace(run)
    for topic in run.system.topics:
        if topic.name == name:
            return topic.type, _kept_trace(run, name)["topics"][name]
    for group in run.layout.groups:
        x = run.system.components[group.owner] if group.owner >= 0 else None
        if x is not None and x.plant is not None and name == f"{x.name}.truth":
            return x.plant.truth, _kept_trace(run, name)[field_name_of_group(group)]
    raise mistake(
        "U001", f"the run has no topic and no truth `{name}`", nearest_or_all(name, _signals(run))
    )


def _module_mode(run: Run, module: str) -> npt.NDArray[np.uint8]:
    """The mode of a module after each instant, (n,); raises SoterError U001."""
    _kept_trace(run)
    for m in run.system.modules:
        if m.name == module:
            return _kept_trace(run, module)["modules"]["mode"][:, m.index]
    known = nearest_or_all(module, [m.name for m in run.system.modules])
    raise mistake("U001", f"the run has no module `{module}`", known)


def _trace_array(run: Run, path: str) -> npt.NDArray[np.float64]:
    """A topic, a truth or a part as floats: (n,) or (n, k); raises SoterError U001."""
    known = [n for n in _signals(run) if path == n or path.startswith(f"{n}.")]
    name = max(known, key=len, default=path)
    t, values = _trace_values(run, name)
    for part in path[len(name) + 1 :].split(".") if len(path) > len(name) else ():
        fields = dict(t.fields) if isinstance(t, RecordType) else {}
        if part not in fields:
            help_ = nearest_or_all(part, fields)
            raise mistake("U001", f"`{path}`: there is no field `{part}`", help_)
        t, values = fields[part], values[part]
    if has_list(t):
        raise mistake("U001", f"`{path}` has a list in it, which is no array", "use run.topic")
    numbers = plain_numbers(t, values)
    return numbers if isinstance(t, (RecordType, ArrayType)) else numbers[:, 0]


def _signals(run: Run) -> list[str]:
    truths = [f"{x.name}.truth" for x in run.system.components if x.plant is not None]
    return [*(t.name for t in run.system.topics), *truths]


# ---------------------------------------------------------------- what a person should know


def _run_notes(run: Run) -> list[str]:
    """The notes of a run, one sentence each."""
    more = (*_late_notes(run), *_silence_notes(run), *_contradiction_notes(run))
    return [*_outside_notes(run), *_nan_notes(run), *_moved_notes(run), *run.computed, *more]


def _outside_notes(run: Run) -> Iterator[str]:
    """Yields notes that a module's `safe` was false on estimates, not on the truth."""
    for name, m in run.modules.items():
        if m.outside:
            yield (
                f"{name}: its `safe` was false on what its topics held in {m.outside:,} of "
                f"{m.looks:,} looks of its DM, first at {m.first_outside_s:.3f} s"
            )


def _nan_notes(run: Run) -> Iterator[str]:
    """Yields a note for each module whose predicates compared a NaN, which counts as danger."""
    for name, m in run.modules.items():
        if m.nan_looks:
            looks = f"{m.nan_looks:,}{' or more' if m.nan_looks == NAN_LOOKS_MAX else ''}"
            yield f"{name}: `ttf` or `safer` compared a NaN in {looks} looks of its DM: danger"


def _moved_notes(run: Run) -> Iterator[str]:
    """Yields notes that a shield moved commands of AC, so that AC's share of time says little."""
    for m, (published, moved) in zip(run.system.modules, run.moved_commands, strict=False):
        if moved:
            share = f"{moved:,} of {published:,} commands of AC"
            yield f"{m.name}: its shield moved {share} toward SC's, {moved / published:.1%}"


def _late_notes(run: Run) -> Iterator[str]:
    """Yields notes that the trusted part was late too often in real time, which voids proofs."""
    timing = run.timing
    if run.misses_recorded:
        yield f"the trusted part was late in this flight: {run.misses_recorded} misses"
    if timing is not None and run.late:
        yield (
            f"the trusted part was late: {timing['misses']} misses, {timing['misses_allowed']} are "
            f"allowed (--misses); nothing was done for {timing['silence_ns'] / 1e6:.1f} ms after "
            f"{timing['silence_after_ns'] / 1e9:.3f} s: {', '.join(silence_words(timing))}"
        )


def silence_words(timing: dict[str, Any]) -> list[str]:
    """A sentence for each module on its actuators in the longest silence of a real-time run."""
    laws = {name: of["silence_law_ns"] for name, of in timing["leases"].items()}
    return [
        f"{name} was held by its law for the last {laws[name] / 1e6:.1f} ms of it"
        if name in laws
        else f"the last command of {name} stayed, as it has no fail-safe law"
        for name in timing["modules"]
    ]


def _silence_notes(run: Run) -> Iterator[str]:
    """Yields notes on externs that published nothing in more than half of their steps."""
    plants = {x.name for x in run.system.components if x.plant is not None}
    for name, tally in run.extern_tallies.items():
        if 2 * tally.silent > tally.steps:
            verb = "answered" if name in plants else "published"
            yield f"{name} {verb} nothing in {tally.silent} of {tally.steps} steps"


def _contradiction_notes(run: Run) -> Iterator[str]:
    """Yields notes that `ttf` (`safe` could be left) and `safer` (there is room) held together."""
    for module, (steps, together) in zip(run.system.modules, run.decided, strict=False):
        if together >= TOGETHER_MIN:
            yield (
                f"{module.name}: ttf and safer held together in {together} of {steps} decisions: "
                "one of them is likely the wrong way round"
            )
