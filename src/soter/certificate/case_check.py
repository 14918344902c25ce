"""The claims about one combination of parameter values.

Purpose: which inclusions each claim needs, and to have them shown on all processors.
Non-goals: the inclusions themselves (`group_claims.py`), certificates (`rechecker.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.format.claimed_parts import FREE, OF_SETS
from soter.certificate.format.errors import RejectedError
from soter.certificate.inclusions import shield
from soter.certificate.inclusions.cell_sets import Cells, Grid, parts, volume
from soter.certificate.inclusions.group_claims import (
    FREE_PIECES,
    PIECES,
    ChainCheck,
    FreeCheck,
    GroupTables,
    free,
    ranked,
    witnessed,
)
from soter.certificate.inclusions.handover_claim import not_entered
from soter.certificate.inclusions.inward_flow import points_inwards, scheme_named
from soter.certificate.inclusions.predicates import (
    AdmitCheck,
    admitted,
    drifts,
    eroded,
    levels_hold,
    published,
)
from soter.certificate.inclusions.sc_chains import delays
from soter.certificate.inclusions.unbounded_axes import nothing_reads
from soter.certificate.polytope.dm_half_spaces import returned
from soter.certificate.polytope.polytope_check import PolytopeCheck
from soter.certificate.polytope.predicates_on_boxes import certain_beside, show_admitted
from soter.certificate.polytope.published_value_ranges import all_published
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.definedness import rates_are_defined
from soter.certificate.reading.linear_flows import is_linear
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.reading.problem import number_of
from soter.certificate.reading.symbolic_values import flat
from soter.certificate.reading.view_predicates import ttf_of_states
from soter.certificate.task_processes import TaskProcesses, can_fork
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from soter.certificate.inclusions.cell_sets import Block
    from soter.certificate.polytope.certificate_tables import PolytopeTables
    from soter.certificate.reading.module_facts import ModuleAbove
    from soter.certificate.reading.problem import Facts

BLOCKS = 24
"""Into how many blocks a grid is dealt out to the processors."""
SMALL = 4_000
"""Cells; a smaller grid is not worth it."""
CELL = 0.05
"""What looking at a cell costs, beside following it for one hold."""


@dataclass(eq=False)
class CaseCheck:
    """The claims about one combination of parameter values."""

    model: CaseModel
    groups: list[GroupTables]
    claims: set[str]
    entry: dict[str, Any]
    progress: Callable[[float], None]
    workers: int
    polytopes: list[PolytopeTables] = field(default_factory=list)
    """Groups that are no grids; their C are the extents of their states."""
    lawful: list[Cells] | None = None
    """K_fs of each group, where SC is to keep the state in what the fail-safe law keeps."""
    tasks: list[tuple[str, Grid, Callable[[Block], Iterator[Block]], Block]] = field(
        default_factory=list
    )
    work: list[float] = field(default_factory=list)
    """What each of the tasks is likely to cost, in holds of one cell: for the progress alone."""
    checks: dict[int, ChainCheck] = field(default_factory=dict)
    running: TaskProcesses | None = None
    done: float = 0.0
    """Of the work."""

    def check(self) -> None:
        """Collect what is to be shown, and show it; RejectedError where it does not hold."""
        self.begin()
        self.finish()

    def begin(self) -> None:
        """Collect what is to be shown, and have it begun; RejectedError where that shows a fault.

        Where processes cannot be forked, or there is one only, it is shown at once.
        """
        with scheme_named(self.model, [g.states for g in self.groups]):
            self._collect()
            self._start_tasks()

    def finish(self) -> None:
        """Wait until everything is shown; RejectedError where it does not hold."""
        if self.running is None:
            return
        with scheme_named(self.model, [g.states for g in self.groups]):
            try:
                for k, failed in self.running.answers():
                    self._note(k, failed)
            finally:
                self.end()

    def end(self) -> None:
        """What still works is not waited for."""
        if self.running is not None:
            self.running.end()

    def _collect(self) -> None:
        self.cores = [Cells(g.grid, g.core > 0) for g in self.groups]
        self.kept = [points_inwards(self.model, g.states) for g in self.groups]
        if self.claims & OF_SETS and any(c.size == 0 for c in self.cores):
            raise RejectedError("K is empty")
        nothing_reads(self.model, len(self.groups) + len(self.polytopes))
        seen_to = [
            g.states
            for g, kept in zip(self.groups, self.kept, strict=True)
            if not kept and not is_linear(self.model, g.states)
        ]
        rates_are_defined(self.model, seen_to)
        if self.claims & OF_SETS:
            self._kernel()
        if self.claims & FREE:
            self._free()
            if self.model.facts.computed:
                self._levels()
            else:
                self._predicates()
        if "P2b" in self.claims:
            self._return()
        if "start" in self.claims:
            self._start()

    @cached_property
    def half_spaces(self) -> list[PolytopeCheck]:
        """What shows the claims about groups that are no grids."""
        return [PolytopeCheck(self.model, p, delays(self.model)) for p in self.polytopes]

    def _never_left(self, index: int, *sets: Cells) -> bool:
        """Whether the sets are the whole grid of a group that no run leaves."""
        return self.kept[index] and all(s.members.all() for s in sets)

    def _chains(self, index: int) -> ChainCheck:
        """Of a group; what is compiled is compiled before processes are forked."""
        if index not in self.checks:
            self.checks[index] = ChainCheck(self.model, self.groups[index])
            self.checks[index].chain(PIECES[0])
        return self.checks[index]

    def _add(
        self,
        what: str,
        grid: Grid,
        show: Callable[[Block], Iterator[Block]],
        holds: NDArray[Any] | None = None,
    ) -> None:
        """A claim about the cells of a grid, in blocks.

        `holds`, of the grid's shape: for how many holds each is followed; None: for less than one.
        """
        cells = int(np.prod(grid.shape))
        for block in parts(grid.whole, BLOCKS if cells > SMALL else 1):
            self.tasks.append((what, grid, show, block))
            work = CELL * volume(block)
            if holds is not None:
                work += float(holds[tuple(slice(a, b) for a, b in block)].sum(dtype=np.float64))
            self.work.append(work)

    def _prove(self, what: str, show: Callable[[], None]) -> None:
        """A claim about a polytope group: shown as a whole, or `RejectedError`."""
        point = Grid(((0.0, 1.0),))
        self.tasks.append((what, point, partial(_shown, show), point.whole))
        self.work.append(CELL)

    def _kernel(self) -> None:
        """K: SC keeps `safe` from it, and leads back to it."""
        safe = self.model.facts.symbol.safe
        allowed = certain_beside(self.model, self.groups, self.polytopes, safe, errors=False)
        for polytope in self.half_spaces:
            self._prove("K", polytope.show_core)
        allowed = self._published(allowed)
        if self.lawful is not None:
            both = zip(allowed, self.lawful, strict=True)
            allowed = [Cells(a.grid, a.members & b.members) for a, b in both]
        for k, (group, core, within) in enumerate(
            zip(self.groups, self.cores, allowed, strict=True)
        ):
            if (core.members & ~within.members).any():
                what = "`safe`" if self.lawful is None else "`safe`, or what the law keeps,"
                raise RejectedError(f"K holds cells on which {what} is not certain")
            if self._never_left(k, core):
                continue
            check = self._chains(k)
            show = partial(witnessed, check, group.core, within, core)
            what = "SC does not certainly lead back to K from"
            self._add(what, group.grid, show, group.core)

    def _published(self, allowed: list[Cells]) -> list[Cells]:
        """The cells, of those given, of whose states all that is published lies in declared sets.

        SC has to keep the state among them, as a plant that publishes anything else stops. Of half-
        spaces the box of C is looked at, else K and what SC does from there.
        """
        facts = self.model.facts
        boxes = [p.as_cell(p.constraint) for p in self.polytopes]
        for topic in bounded_topics(facts):
            cells = published(self.model, [*self.groups, *boxes], topic)
            for core, within in zip(self.cores, cells, strict=False):
                if (core.members & ~within.members).any():
                    name = facts.system.topics[topic].name
                    raise RejectedError(
                        f"K holds states of which it was not shown that what a plant publishes on "
                        f"`{name}` lies in its declared set: elsewhere it stops"
                    )
            allowed = [
                Cells(a.grid, a.members & b.members) for a, b in zip(allowed, cells, strict=False)
            ]
            certain = all(c.members.all() for c in cells[len(self.groups) :])
            certain = certain or all_published(self.model, self.half_spaces, topic)
            if not certain and not facts.symbol.verify.abstracts:
                name = facts.system.topics[topic].name
                raise NotRecheckedError(
                    f"it was not shown over the half-spaces of K that what a plant "
                    f"publishes on `{name}` lies in its declared set: elsewhere it stops"
                )
            facts.in_sets[topic] = certain and facts.in_sets.get(topic, True)
        return allowed

    def _free(self) -> None:
        """R(H): nothing leads out of K within H."""
        horizon = self.model.facts.times["H_ns"]
        for polytope in self.half_spaces:
            self._prove("R(H)", partial(polytope.show_free, horizon))
        for k, (group, core) in enumerate(zip(self.groups, self.cores, strict=True)):
            if group.free is None:
                raise RejectedError("a claim needs R, which is not there")
            if self._never_left(k, core):
                continue
            check = FreeCheck(self.model, group, horizon)
            check.phase(FREE_PIECES[0])
            show = partial(free, check, Cells(group.grid, group.free), core)
            self._add("some command leads out of K within H from", group.grid, show)

    def _predicates(self) -> None:
        """Where `ttf` may be false or `safer` true, on an estimate, the state is in R(H)."""
        symbol = self.model.facts.symbol
        wanted: list[tuple[str, Any, bool]] = []
        if self.claims & {"P3", "ttf"}:
            wanted.append(("ttf", ttf_of_states(symbol.ttf), False))
        if self.claims & {"P3", "safer"}:
            wanted.append(("safer", symbol.safer, True))
        for name, expr, admits in wanted:
            if expr is None:
                raise NotRecheckedError("computed predicates are not rechecked yet")
            for p in self.polytopes:
                shown = partial(show_admitted, self.model, p, name, expr, admits=admits)
                self._prove(f"`{name}`", shown)
            for group in self.groups:
                assert group.free is not None
                if group.free.all():
                    continue
                show: Any = partial(admitted, AdmitCheck(self.model, group, expr, admits=admits))
                what = f"`{name}` may leave AC in control outside R(H) in"
                self._add(what, group.grid, show)

    def _return(self) -> None:
        """P2b: Q is kept within `safer`, and W leads there from all of K."""
        self._recover()
        allowed = self._calm()
        for k, (group, core, within) in enumerate(
            zip(self.groups, self.cores, allowed, strict=True)
        ):
            if group.home is None or group.rank is None or group.rank_holds is None:
                raise RejectedError("a claim needs Q and W, which are not there")
            home = Cells(group.grid, group.home > 0)
            if (home.members & ~within.members).any():
                raise RejectedError("Q holds cells on which `safer` is not certain")
            if (core.members & ~home.members & (group.rank == 0)).any():
                raise RejectedError("W does not hold all of K")
            if (home.members & (group.rank != 1)).any():
                raise RejectedError("W does not begin with Q")
            if ((group.rank <= 1) & (group.rank_holds > 0)).any():
                raise RejectedError("W says how long it takes where there is nowhere to go")
            if self._never_left(k, home):
                continue
            check = self._chains(k)
            kept = partial(witnessed, check, group.home, within, home)
            what = "SC does not certainly stay where `safer` holds from"
            self._add(what, group.grid, kept, group.home)
            show, what = partial(ranked, check, home), "SC does not certainly come nearer to Q from"
            self._add(what, group.grid, show, group.rank_holds)

    def _calm(self) -> list[Cells]:
        """States on all of whose estimates `safer` certainly holds."""
        safer = self.model.facts.symbol.safer
        for check in self.half_spaces:
            self._prove("Q", check.show_home)
            if safer is None:
                self._prove("Q", partial(returned, check.tables, check.errors))
        if safer is not None:
            return certain_beside(self.model, self.groups, self.polytopes, safer, errors=True)
        cells = []
        for group in self.groups:
            if group.given_back is None:
                raise RejectedError("a claim needs the table of the DM, which is not there")
            cells.append(eroded(self.model, group, Cells(group.grid, group.given_back)))
        return cells

    def _levels_of(self, group: GroupTables) -> list[Cells]:
        """S_0, ..., S_(m-2)."""
        count = self.model.facts.levels - 1
        if len(group.levels) < count:
            raise RejectedError("a claim needs the tables S, which are not there")
        return [Cells(group.grid, s) for s in group.levels[:count]]

    def _levels(self) -> None:
        """Computed predicates: ttf is not S_0, safer is S_(m-2)."""
        between = self.model.facts.between_ns
        for polytope in self.half_spaces:
            self._prove("S", partial(polytope.show_levels, between))
        for i, group in enumerate(self.groups):
            assert group.free is not None
            if len(group.levels) != self.model.facts.levels - 1:
                raise RejectedError("the tables S are not as many as the levels ask for")
            levels = self._levels_of(group)
            free = Cells(group.grid, group.free)
            show: Any = partial(levels_hold, self.model, group, levels[0], free)
            self._add("an estimate in S_0 may be of a state outside R(H), in", group.grid, show)
            if self.model.facts.symbol.shield is not None:
                for what, of_commands in shield.to_show(self.model, group, self.cores[i]):
                    self._add(what, group.grid, of_commands)
            check = FreeCheck(self.model, group, between)
            for k in range(1, len(levels)):
                if (levels[k].members & ~levels[k - 1].members).any():
                    raise RejectedError(f"S_{k} is no part of S_{k - 1}")
                calm = eroded(self.model, group, levels[k - 1])
                if self._never_left(i, calm):
                    continue
                show = partial(drifts, check, levels[k], calm)
                what = f"S_{k} may be left for outside S_{k - 1} at once, from"
                self._add(what, group.grid, show)

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
        facts = self.model.facts
        longest = max((p.periods for p in self.polytopes), default=0)
        for group in self.groups:
            if group.rank is None or group.rank_holds is None:
                raise RejectedError("a claim needs Q and W, which are not there")
            of_rank = np.zeros(int(group.rank.max()) + 1, dtype=np.int64)
            np.maximum.at(of_rank, group.rank.reshape(-1), group.rank_holds.reshape(-1))
            longest = max(longest, int(of_rank[1:].sum()))
        bound = longest * facts.times["delta_ns"] + facts.jitter_ns  # a_N is late by j at most
        bound += facts.decide_ns
        if bound > wanted:
            raise RejectedError("SC may take longer to return than the program allows")

    def _start(self) -> None:
        """The declared initial states stay in K until SC acts, whatever acts before."""
        facts = self.model.facts
        if facts.above is not None:
            self._handed_back(facts.above)
            return
        if not _is_initial(facts, self.model.parameter):
            return
        for polytope in self.half_spaces:
            own = [facts.states[i] for i in polytope.tables.states]
            low, high = [s.low for s in own], [s.high for s in own]
            self._prove("start", partial(polytope.show_start, low, high, facts.start_ns))
        if self.polytopes:
            self._start_in_sets()
        for k, (group, core) in enumerate(zip(self.groups, self.cores, strict=True)):
            box = Grid(tuple(starts_of(facts, group)))
            inside = group.grid.cells([end for edges in box.edges for end in edges]) is not None
            if inside and self._never_left(k, core):
                continue
            check = FreeCheck(self.model, group, facts.start_ns)
            if not check.stays(box.box(box.whole), core, FREE_PIECES[1]):
                raise RejectedError("an initial state may leave K before SC acts")
        for topic in {c.owner for c in facts.controls}:
            default = facts.system.topics[topic]
            for c, value in zip(
                [c for c in facts.controls if c.owner == topic], _leaves(default), strict=True
            ):
                if not c.low <= value <= c.high:
                    raise RejectedError(f"the default of `{c.name}` is outside its set")

    def _handed_back(self, above: ModuleAbove) -> None:
        """Below another module: wherever that one may give control back, the state is in R(H)."""
        if not self.claims & {"P3", "ttf", "safer"} or self.polytopes:
            raise RejectedError("start: nothing is claimed with which R(H) is confirmed on cells")
        why = not_entered(self.model, self.groups, above.safer)
        if why:
            raise RejectedError(f"start: `{above.name}` may give control back elsewhere: {why}")

    def _start_in_sets(self) -> None:
        """What is published of the initial states lies in its set: K says so only of grids."""
        facts = self.model.facts
        ends = tuple((s.low, s.high) for s in facts.states)
        at_start = CaseModel(facts, self.model.parameter, ends)
        one = np.ones((1,) * len(ends), dtype=np.uint8)
        box = GroupTables(tuple(range(len(ends))), Grid(ends), one)
        for topic in bounded_topics(facts):
            if not published(at_start, [box], topic)[0].members.all():
                name = facts.system.topics[topic].name
                raise RejectedError(f"an initial state may be none of those that `{name}` holds")

    def _start_tasks(self) -> None:
        """The long ones first: ranks are asked for last."""
        self.tasks, self.work = self.tasks[::-1], self.work[::-1]
        workers = min(self.workers, len(self.tasks))
        if workers > 1 and can_fork():
            self.running = TaskProcesses(len(self.tasks), self._answer, workers)
            return
        for k in range(len(self.tasks)):
            self._note(k, self._answer(k))

    def _answer(self, k: int) -> str:
        """What one task shows: empty, or what went wrong."""
        what, grid, show, block = self.tasks[k]
        failed = next(show(block), None)
        return "" if failed is None else f"{what} {grid.text(failed)}"

    def _note(self, k: int, failed: str) -> None:
        if failed:
            case = ", ".join(
                f"{p.name} = {v}"
                for p, v in zip(self.model.facts.parameters, self.model.parameter, strict=True)
            )
            raise RejectedError(failed + (f" ({case})" if case else ""))
        self.done += self.work[k]
        self.progress(self.done / sum(self.work))


def _shown(show: Callable[[], None], _: Block) -> Iterator[Block]:
    """A claim that is shown as a whole leaves no cell."""
    show()
    return iter(())


def _leaves(topic: Any) -> list[float]:  # noqa: ANN401
    assert len(flat(topic.default)) == len(list(leaves(topic.type)))
    return flat(topic.default)


def starts_of(facts: Facts, group: GroupTables) -> Iterator[tuple[float, float]]:
    """The declared initial range of each state; what lies beyond an axis without ends is moved in.

    What is shown of runs from its outer cells holds of those from beyond (`cell_sets.py`).
    """
    for k, i in enumerate(group.states):
        ends = facts.states[i].low, facts.states[i].high
        edges = group.grid.edges[k]
        if group.grid.has_no_ends(k):
            low, high = (min(max(x, edges[0]), edges[-1]) for x in ends)
            ends = low, high
        yield ends


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
