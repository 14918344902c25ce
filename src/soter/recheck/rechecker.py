"""Check a certificate: hashes, then the problem, then every claim.

Purpose: `recheck(folder)`: from the bytes of a certificate to a `Report`: accepted, or the reason
why not. Whatever this room does not know how to confirm is rejected, never accepted.
Non-goals: finding sets or witnesses: there is no search and no fixpoint here, one pass only.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.program.build import check_file, system_of
from soter.program.types import DurationType, FloatType, leaves
from soter.recheck.claims import CLAIMS, claimed_of
from soter.recheck.folder import Certificate, read_certificate
from soter.recheck.inclusion import (
    FREE_PIECES,
    PIECES,
    ChainCheck,
    FreeCheck,
    GroupTables,
    RejectedError,
    admitted,
    certain,
    drifts,
    eroded,
    free,
    levels_hold,
    ranked,
    witnessed,
)
from soter.recheck.model import Model
from soter.recheck.problem import DiffersError, Facts, number_of, read_facts
from soter.recheck.symbolic import flat
from soter.recheck.tables import Cells, Grid, parts
from soter.recheck.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from soter.program.build import Checked
    from soter.program.typed import Expr
    from soter.recheck.tables import Block

BLOCKS = 24
"""Into how many blocks a grid is dealt out to the processors."""
SMALL = 4_000
"""Cells; a smaller grid is not worth it."""
TIME_KEYS = (
    "Delta_ns",
    "delta_ns",
    "A_ns",
    "A_sc_ns",
    "J_dm_ns",
    "J_sc_ns",
    "R_dm_ns",
    "R_sc_ns",
    "L_ns",
    "H_ns",
    "H_star_ns",
)


@dataclass
class ModuleReport:
    """What was confirmed about a module."""

    name: str
    claims: dict[str, str]
    cells: int = 0
    confirmed: list[str] = field(default_factory=list)

    @property
    def other(self) -> list[str]:
        """Properties that are not said to be proved, with what is said."""
        return [f"{n} ({v})" for n, v in self.claims.items() if n not in self.confirmed]


@dataclass
class Report:
    """`accepted`, or why not; `seconds` and cells for people."""

    accepted: bool
    reason: str = ""
    modules: list[ModuleReport] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    program_sha256: str = ""
    seconds: float = 0.0


def recheck(
    folder: Path, progress: Callable[[float], None] | None = None, workers: int | None = None
) -> Report:
    """Check the certificate in a folder; `NotACertificateError` where there is none.

    `progress` is called with the share that is done; `workers`: processes, by default one for
    each processor.
    """
    started = time.perf_counter()
    report = Report(accepted=False)
    try:
        certificate = read_certificate(folder)
        _check(certificate, report, progress or (lambda _: None), workers or os.cpu_count() or 1)
        report.accepted = True
    except (RejectedError, DiffersError) as error:
        report.reason = str(error)
    except NotRecheckedError as error:
        report.reason = f"not rechecked: {error}"
    except SoterError as error:
        report.reason = f"the program of the certificate: {error}"
    report.seconds = time.perf_counter() - started
    return report


def _check(
    certificate: Certificate, report: Report, progress: Callable[[float], None], workers: int
) -> None:
    manifest = certificate.manifest
    _keys(
        manifest,
        ("schema", "soter", "files", "main", "params", "modules", "program_sha256"),
        "the manifest",
    )
    checked = _program(certificate)
    assert checked.program is not None
    report.program_sha256 = checked.program.sha256
    modules = manifest["modules"]
    if not isinstance(modules, list) or not modules:
        raise RejectedError("the manifest has no modules")
    for k, entry in enumerate(modules):
        share = partial(_share, progress, k, len(modules))
        report.modules.append(_module(certificate, checked, entry, share, workers))
        report.assumptions += [a for a in entry["assumptions"] if a not in report.assumptions]
    unused = {n for n in certificate.contents if n.startswith("sets/")} - certificate.used
    for name in sorted(unused):
        raise RejectedError(f"no claim rests on `{name}`")


def _share(progress: Callable[[float], None], k: int, count: int, done: float) -> None:
    progress((k + done) / count)


def _keys(entry: object, names: tuple[str, ...], what: str) -> None:
    if not isinstance(entry, dict):
        raise RejectedError(f"{what} is not as it should be")
    for name in sorted(entry.keys() ^ set(names)):
        raise RejectedError(f"{what} has {'no' if name in names else 'an unknown'} `{name}`")


# ---------------------------------------------------------------- the program


def _program(certificate: Certificate) -> Checked:
    """The checked program of the certificate; only its own files are read."""
    main = certificate.manifest["main"]
    if not isinstance(main, str) or f"program/{main}" not in certificate.contents:
        raise RejectedError(f"the main file `{main}` is not in the certificate")
    checked = check_file(
        str(certificate.folder / "program" / main), None, _overrides(certificate, {})
    )
    if checked.program is not None:
        overrides = _overrides(certificate, checked.program.params)
        checked = check_file(str(certificate.folder / "program" / main), None, overrides)
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != certificate.manifest["program_sha256"]:
        raise RejectedError("the program is another one than the manifest says")
    return checked


def _overrides(certificate: Certificate, known: Mapping[str, Any]) -> dict[str, Any]:
    """Values of parameters; floats are written as C99 hexadecimal texts."""
    params = certificate.manifest["params"]
    if not isinstance(params, dict):
        raise RejectedError("`params` is not as it should be")
    found = {}
    for name, symbol in known.items():
        if name not in params:
            continue
        value = params[name]
        if isinstance(symbol.type, FloatType):
            value = _hexadecimal(value, name)
        elif isinstance(value, str) or (isinstance(symbol.type, DurationType) and value < 0):
            raise RejectedError(f"parameter `{name}` is not as it should be")
        found[name] = value
    if known and params.keys() - known.keys():
        raise RejectedError("`params` names what is no parameter of the program")
    return found


def _hexadecimal(text: object, what: str) -> float:
    try:
        value = float.fromhex(text)  # type: ignore[arg-type]  # checked here
    except (TypeError, ValueError, OverflowError):
        raise RejectedError(f"`{what}` is no hexadecimal number") from None
    if text != value.hex() or value - value != 0.0:
        raise RejectedError(f"`{what}` is not written as it should be")
    return value


# ---------------------------------------------------------------- a module


def _module(
    certificate: Certificate,
    checked: Checked,
    entry: dict[str, Any],
    progress: Callable[[float], None],
    workers: int,
) -> ModuleReport:
    _keys(
        entry,
        (
            "system",
            "module",
            "plants",
            "parameters",
            "times",
            "inputs",
            "cases",
            "claims",
            "assumptions",
            "recover_ns",
        ),
        "a module",
    )
    overrides = _overrides(certificate, checked.program.params if checked.program else {})
    if entry["system"] not in checked.systems:
        raise RejectedError(f"the program has no system `{entry['system']}`")
    facts = read_facts(system_of(checked, entry["system"], overrides), entry["module"])
    extents = _compare(facts, entry)
    report = ModuleReport(entry["module"], entry["claims"])
    claims = claimed_of(entry["claims"])
    cases = list(facts.cases())
    given = [tuple(c["parameter"]) for c in entry["cases"]]
    if given != cases:
        raise RejectedError("the cases are not all combinations of the parameters' values")
    for k, (values, case) in enumerate(zip(cases, entry["cases"], strict=True)):
        _keys(case, ("parameter", "groups"), "a case")
        model = Model(facts, values, extents)
        groups = _groups(certificate, facts, extents, case["groups"])
        report.cells += sum(int(np.prod(g.grid.shape)) for g in groups)
        share = partial(_share, progress, k, len(cases))
        _Case(model, groups, claims, entry, share, workers).check()
    report.confirmed = [c for c in CLAIMS if c in claims]
    return report


def _compare(facts: Facts, entry: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    """Every figure of the manifest against the program; gives back the extents of the grid."""
    if entry["plants"] != [c.name for c in facts.plants]:
        raise RejectedError("the verification plants are others in the program")
    parameters = [{"name": p.name, "values": list(p.values)} for p in facts.parameters]
    if entry["parameters"] != parameters:
        raise RejectedError("the parameters are others in the program")
    _keys(entry["times"], TIME_KEYS, "`times`")
    for key in TIME_KEYS:
        if entry["times"][key] != facts.times[key] or isinstance(entry["times"][key], bool):
            raise RejectedError(
                f"{key} is {entry['times'][key]} in the manifest, {facts.times[key]} by the program"
            )
    inputs = entry["inputs"]
    if not isinstance(inputs, list):
        raise RejectedError("`inputs` is not as it should be")
    others = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    if len(inputs) != len(facts.states) + len(others):
        raise RejectedError("the inputs are others in the program")
    extents = []
    for i, (given, known) in enumerate(zip(inputs, [*facts.states, *others], strict=True)):
        _keys(given, ("name", "kind", "low", "high"), "an input")
        if (given["name"], given["kind"]) != (known.name, known.kind):
            raise RejectedError(f"input {given['name']} is {known.name} by the program")
        low, high = (_hexadecimal(given[k], known.name) for k in ("low", "high"))
        if i < len(facts.states):
            if facts.axes.get(i, (low, high)) != (low, high):
                raise RejectedError(f"the grid of {known.name} is another one in the program")
            extents.append((low, high))
        elif (low, high) != (known.low, known.high):
            raise RejectedError(f"the range of {known.name} is another one in the program")
    return tuple(extents)


def _groups(
    certificate: Certificate,
    facts: Facts,
    extents: tuple[tuple[float, float], ...],
    entries: list[dict[str, Any]],
) -> list[GroupTables]:
    names = {s.name: i for i, s in enumerate(facts.states)}
    found, seen = [], []
    for entry in entries:
        if entry.get("kind") != "grid":
            raise NotRecheckedError(f"{entry.get('kind')} groups are not rechecked yet")
        _keys(entry, (*REQUIRED, *(k for k in OPTIONAL if k in entry)), "a group")
        states, edges = [], []
        for axis in entry["axes"]:
            _keys(axis, ("state", "edges"), "an axis")
            if axis["state"] not in names:
                raise RejectedError(f"there is no state `{axis['state']}`")
            state = names[axis["state"]]
            states.append(state)
            edges.append(certificate.edges(axis["edges"]))
            if (edges[-1][0], edges[-1][-1]) != extents[state]:
                raise RejectedError(f"the edges of {axis['state']} do not span its range")
        seen += states
        found.append(_tables(certificate, entry, tuple(states), Grid(tuple(edges))))
    if sorted(seen) != list(range(len(facts.states))):
        raise RejectedError("the groups do not hold every state exactly once")
    return found


REQUIRED = ("kind", "axes", "K")
OPTIONAL = ("R", "Q", "W", "W_N", "S")


def _tables(
    certificate: Certificate, entry: dict[str, Any], states: tuple[int, ...], grid: Grid
) -> GroupTables:
    shape = grid.shape
    found = GroupTables(states, grid, certificate.numbers(entry["K"], shape, "<u1"))
    if "R" in entry:
        found.free = certificate.bits(entry["R"], shape)
    if "Q" in entry:
        found.home = certificate.numbers(entry["Q"], shape, "<u1")
    if "W" in entry:
        found.rank = certificate.numbers(entry["W"], shape, "<u2")
        found.rank_holds = certificate.numbers(entry.get("W_N"), shape, "<u1")
    found.levels = [certificate.bits(path, shape) for path in entry.get("S", [])]
    return found


# ---------------------------------------------------------------- a case


@dataclass(eq=False)
class _Case:
    """The claims about one combination of parameter values."""

    model: Model
    groups: list[GroupTables]
    claims: set[str]
    entry: dict[str, Any]
    progress: Callable[[float], None]
    workers: int
    tasks: list[tuple[str, Grid, Callable[[Block], list[Block]], Block]] = field(
        default_factory=list
    )

    def check(self) -> None:
        """Collect what is to be shown, then show it."""
        symbol = self.model.facts.symbol
        self.computed = symbol.ttf is None and symbol.safer is None
        self.cores = [Cells(g.grid, g.core > 0) for g in self.groups]
        if any(c.size == 0 for c in self.cores):
            raise RejectedError("K is empty")
        if self.claims & {"P2a", "P2b", "P3", "ttf", "safer", "start"}:
            self._kernel()
        if self.claims & {"P2a", "P3", "ttf", "safer"}:
            self._free()
            if self.computed:
                self._levels()
            else:
                self._predicates()
        if "P2b" in self.claims:
            self._return()
        if "start" in self.claims:
            self._start()
        self._run()

    def _add(self, what: str, grid: Grid, show: Callable[[Block], list[Block]]) -> None:
        cells = int(np.prod(grid.shape))
        for block in parts(grid.whole, BLOCKS if cells > SMALL else 1):
            self.tasks.append((what, grid, show, block))

    def _kernel(self) -> None:
        """K: SC keeps `safe` from it, and leads back to it."""
        allowed = certain(self.model, self.groups, self.model.facts.symbol.safe, errors=False)
        for group, core, within in zip(self.groups, self.cores, allowed, strict=True):
            if (core.members & ~within.members).any():
                raise RejectedError("K holds cells on which `safe` is not certain")
            check = ChainCheck(self.model, group)
            check.chain(PIECES[0])
            show = partial(witnessed, check, group.core, within, core.contains)
            self._add("SC does not certainly lead back to K from", group.grid, show)

    def _free(self) -> None:
        """R(H): nothing leads out of K within H."""
        horizon = self.model.facts.times["H_ns"]
        for group, core in zip(self.groups, self.cores, strict=True):
            if group.free is None:
                raise RejectedError("a claim needs R, which is not there")
            check = FreeCheck(self.model, group, horizon)
            check.phase(FREE_PIECES[0])
            show = partial(free, check, Cells(group.grid, group.free), core)
            self._add("some command leads out of K within H from", group.grid, show)

    def _predicates(self) -> None:
        """Where `ttf` may be false or `safer` true, on an estimate, the state is in R(H)."""
        symbol = self.model.facts.symbol
        wanted: list[tuple[str, Any, bool]] = []
        if self.claims & {"P2a", "P3", "ttf"}:
            wanted.append(("ttf", symbol.ttf, False))
        if self.claims & {"P2a", "P3", "safer"}:
            wanted.append(("safer", symbol.safer, True))
        for name, expr, admits in wanted:
            if expr is None:
                raise NotRecheckedError("computed predicates are not rechecked yet")
            for group in self.groups:
                assert group.free is not None
                proved = Cells(group.grid, group.free)
                show: Any = partial(_admitted, self.model, group, expr, admits, proved)
                self._add(f"`{name}` may leave AC in control outside R(H) in", group.grid, show)

    def _return(self) -> None:
        """P2b: Q is kept within `safer`, and W leads there from all of K."""
        allowed = self._calm()
        for group, core, within in zip(self.groups, self.cores, allowed, strict=True):
            if group.home is None or group.rank is None or group.rank_holds is None:
                raise RejectedError("a claim needs Q and W, which are not there")
            home = Cells(group.grid, group.home > 0)
            if (home.members & ~within.members).any():
                raise RejectedError("Q holds cells on which `safer` is not certain")
            if (core.members & ~home.members & (group.rank == 0)).any():
                raise RejectedError("W does not hold all of K")
            check = ChainCheck(self.model, group)
            check.chain(PIECES[0])
            kept = partial(witnessed, check, group.home, within, home.contains)
            self._add("SC does not certainly stay where `safer` holds from", group.grid, kept)
            show = partial(ranked, check, home)
            self._add("SC does not certainly come nearer to Q from", group.grid, show)
        self._recover()

    def _calm(self) -> list[Cells]:
        """States on all of whose estimates `safer` certainly holds."""
        safer = self.model.facts.symbol.safer
        if safer is not None:
            return certain(self.model, self.groups, safer, errors=True)
        return [eroded(self.model, g, self._levels_of(g)[-1]) for g in self.groups]

    def _levels_of(self, group: GroupTables) -> list[Cells]:
        """S_0, ..., S_(m-2)."""
        count = self.model.facts.levels - 1
        if len(group.levels) < count:
            raise RejectedError("a claim needs the tables S, which are not there")
        return [Cells(group.grid, s) for s in group.levels[:count]]

    def _levels(self) -> None:
        """Computed predicates: ttf is not S_0, safer is S_(m-2)."""
        times = self.model.facts.times
        between = times["Delta_ns"] + times["A_ns"] + times["J_dm_ns"]
        for group in self.groups:
            assert group.free is not None
            if len(group.levels) != self.model.facts.levels - 1:
                raise RejectedError("the tables S are not as many as the levels ask for")
            levels = self._levels_of(group)
            free = Cells(group.grid, group.free)
            show: Any = partial(levels_hold, self.model, group, levels[0], free)
            self._add("an estimate in S_0 may be of a state outside R(H), in", group.grid, show)
            check = FreeCheck(self.model, group, between)
            for k in range(1, len(levels)):
                if (levels[k].members & ~levels[k - 1].members).any():
                    raise RejectedError(f"S_{k} is no part of S_{k - 1}")
                calm = eroded(self.model, group, levels[k - 1])
                show = partial(drifts, check, levels[k], calm)
                self._add(
                    f"S_{k} may be left for outside S_{k - 1} at once, from", group.grid, show
                )

    def _recover(self) -> None:
        """The time to return, bounded by the longest witness of every rank."""
        wanted = self.entry["recover_ns"]
        declared = self.model.facts.symbol.verify.recover
        if declared is None:
            if wanted is not None:
                raise RejectedError("the program declares no time to return")
            return
        if wanted != number_of(self.model.facts, declared):
            raise RejectedError("the time to return is another one in the program")
        times = self.model.facts.times
        longest = 0
        for group in self.groups:
            assert group.rank is not None
            assert group.rank_holds is not None
            total = 0
            for rank in range(1, int(group.rank.max()) + 1):
                holds = group.rank_holds[group.rank == rank]
                total += int(holds.max()) if holds.size else 0
            longest = max(longest, total)
        bound = longest * times["delta_ns"] + times["Delta_ns"] + times["A_ns"] + times["J_dm_ns"]
        if bound > wanted:
            raise RejectedError("SC may take longer to return than the program allows")

    def _start(self) -> None:
        """The declared initial states stay in K until SC acts, whatever acts before."""
        facts = self.model.facts
        if not _is_initial(facts, self.model.parameter):
            return
        times = facts.times
        before = facts.sc.phase_ns + times["J_sc_ns"] + times["R_sc_ns"] + times["L_ns"]
        for group, core in zip(self.groups, self.cores, strict=True):
            box = Grid(tuple((facts.states[i].low, facts.states[i].high) for i in group.states))
            check = FreeCheck(self.model, group, before)
            if not check.stays(box.box(box.whole), core, FREE_PIECES[1]):
                raise RejectedError("an initial state may leave K before SC acts")
        for topic in {c.owner for c in facts.controls}:
            default = facts.system.topics[topic]
            for c, value in zip(
                [c for c in facts.controls if c.owner == topic], _leaves(default), strict=True
            ):
                if not c.low <= value <= c.high:
                    raise RejectedError(f"the default of `{c.name}` is outside its set")

    def _run(self) -> None:
        global _TASKS  # noqa: PLW0603  what the forked processes see
        _TASKS = self.tasks
        workers = min(self.workers, len(self.tasks))
        done = 0
        if workers > 1 and "fork" in multiprocessing.get_all_start_methods():
            with multiprocessing.get_context("fork").Pool(workers) as pool:
                for failed in pool.imap_unordered(_show, range(len(self.tasks))):
                    self._note(failed)
                    done += 1
                    self.progress(done / len(self.tasks))
            return
        for k in range(len(self.tasks)):
            self._note(_show(k))
            self.progress((k + 1) / len(self.tasks))

    def _note(self, failed: str) -> None:
        if failed:
            case = ", ".join(
                f"{p.name} = {v}"
                for p, v in zip(self.model.facts.parameters, self.model.parameter, strict=True)
            )
            raise RejectedError(failed + (f" ({case})" if case else ""))


_TASKS: list[tuple[str, Grid, Any, Any]] = []


def _show(k: int) -> str:
    """One task: empty, or what went wrong."""
    what, grid, show, block = _TASKS[k]
    failed = show(block)
    return f"{what} {grid.text(failed[0])}" if failed else ""


def _admitted(
    model: Model, group: GroupTables, expr: Expr, admits: bool, proved: Cells, block: Block
) -> list[Block]:
    return admitted(model, group, expr, admits=admits, proved=proved, block=block)


def _leaves(topic: Any) -> list[float]:  # noqa: ANN401
    assert len(flat(topic.default)) == len(list(leaves(topic.type)))
    return flat(topic.default)


def _is_initial(facts: Facts, values: tuple[int, ...]) -> bool:
    """Whether a run may start with these values of the parameters."""
    for p, v in zip(facts.parameters, values, strict=True):
        component = next(c for c in facts.plants if c.index == p.owner)
        assert component.plant is not None
        names = [s.name for s in component.plant.states]
        at = names.index(p.variable)
        drawn = component.initial_range[at]
        if drawn is not None:
            if not drawn[0] <= v <= drawn[1]:
                return False
        elif int(flat(component.initial[at])[p.leaf]) != v:
            return False
    return True
