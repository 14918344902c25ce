"""Finds the safe controllers that a program leaves open (`soter verify --synthesize`).

Purpose: `synthesize` computes with the grid engine the sets from which `synthesized_sc.py` chooses
a law for each such module, and writes the program with the found controllers. `core_synthesis`
computes, for one group, K with a table of commands on estimates.
Non-goals: proofs. The written program is an ordinary one; `soter verify` judges it.

K, the core, is computed with each command held for `hold` periods of SC: in one period of a fast SC
a state moves less than a cell, and then rounding to whole cells leaves nothing of K.

A table has one entry per cell of the estimate: [low, high) along each axis, the last cell closed.
A cell c of states and a cell e of estimates are *compatible* if some state of c lies in e.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.current_phase import share_done
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.front_end import check_file
from soter.language.load.named_files import ReadError, open_finite_file
from soter.verify import synthesized_sc
from soter.verify.chosen_modules import modules_of
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.grid import sets as grids
from soter.verify.grid.grid_problem import grid_inputs_of
from soter.verify.grid.group_model import UnboundedError
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.extract import extract
from soter.verify.synthesized_sc import CellCommands, block_law, command_combinations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    from numpy.typing import NDArray

    from soter.core.layout import Bools, Bytes, Floats
    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module
    from soter.language.model.types import Value
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.problem.problem import Problem
    from soter.verify.synthesized_sc import LawTable

    Masks = npt.NDArray[np.uint64]


ALL = np.uint64(2**64 - 1)


@dataclass(frozen=True)
class SynthesizedCommands:
    """A synthesised SC: `cells` is K, `choice` the number of the command for each estimate cell.

    The value 255 is no command. In K the chosen command, held for one period, keeps C and leads
    back into K, from every state and for each estimate of this state.
    """

    cells: Bools
    choice: Bytes
    commands: Floats
    admits: Masks
    """For each true cell of K, bit k is set if command k, held for a period, leads back into K."""


class _Synthesis:
    """Computes K and its command table as a fixpoint over the commands of cells."""

    def __init__(self, group: GridGroup, allowed: Bools, commands: Floats) -> None:
        self.group, self.commands = group, commands
        ffi, n, size = group.library.ffi, len(group.axes), allowed.size
        self.work = ffi.new("soter_reach_choice *")
        self.memory = group.allocate_rounds(self.work.r)
        self.allowed = group.bits_of(allowed)
        self.fine = np.empty(group.shape, dtype=np.uint64)
        self.image = np.empty((*group.shape, len(commands), n, 2), dtype=np.uint16)
        assert self.image.size == size * len(commands) * n * 2
        w, at = self.work, group.pointer
        w.allowed, w.fine = at(self.allowed, "uint64_t *"), at(self.fine, "uint64_t *")
        w.image, w.commands = at(self.image, "uint16_t *"), at(commands, "double *")
        w.count = len(commands)

    def run_to_fixpoint(self) -> Bools:
        """Runs the engine to its fixpoint and returns K so far."""
        group, lib = self.group, self.group.library.lib
        while not lib.soter_reach_choice_continue(group.c, self.work, grids.SLICE_S, group.threads):
            share_done(0.0, "synthesis")  # nobody knows how many rounds are left
        return group.cells_of(self.memory["kept"])

    def masks_by_estimate(self, kept: Bools) -> Masks:
        """The masks, by estimate cell, of commands that serve all compatible cells of K.

        An estimate cell without a compatible cell has ALL. An estimate on the lower face of a cell
        also belongs to the cell below, unless the upper cell is in K.
        """
        masks = np.where(kept, self.fine, ALL)
        for axis in range(masks.ndim):
            below = np.full_like(masks, ALL)
            into: list[slice] = [slice(None)] * masks.ndim
            out = list(into)
            into[axis], out[axis] = slice(1, None), slice(None, -1)
            below[tuple(into)] = masks[tuple(out)]
            masks = np.where(kept, masks, masks & below)
        return masks

    def cells_in_conflict(self, kept: Bools, masks: Masks) -> Bools:
        """The cells to remove because no command serves all cells compatible with an estimate.

        The command that serves most of these cells is kept; the cells that it does not serve go.
        """
        wanted, lost = np.argwhere(masks == 0), np.zeros_like(kept)
        reach = self.group.overlapped_cells({})
        for cell in wanted:
            box = tuple(
                slice(max(0, int(first[i]) - 1), int(last[i]) + 1)
                for i, (first, last) in zip(cell, reach, strict=True)
            )
            compatible, fine = kept[box] & ~lost[box], self.fine[box]
            serves = [
                int((compatible & ((fine >> np.uint64(k)) & np.uint64(1) != 0)).sum())
                for k in range(len(self.commands))
            ]
            best = np.uint64(int(np.argmax(serves)))
            lost[box] |= compatible & ((fine >> best) & np.uint64(1) == 0)
        return lost

    def find_table(self) -> SynthesizedCommands:
        group, lib = self.group, self.group.library.lib
        lib.soter_reach_choice_begin(group.c, self.work)
        while True:
            kept = self.run_to_fixpoint()
            masks = self.masks_by_estimate(kept)
            if masks.all():
                admits = np.where(kept, self.fine, np.uint64(0))
                return SynthesizedCommands(kept, self.command_by_cell(masks), self.commands, admits)
            lost = np.ascontiguousarray(self.cells_in_conflict(kept, masks)).view(np.uint8)
            lib.soter_reach_choice_remove(group.c, self.work, group.pointer(lost, "uint8_t *"))
            share_done(0.0, "synthesis")

    def command_by_cell(self, masks: Masks) -> Bytes:
        """For each estimate cell the first command that serves; 255 if no state of K fits."""
        count = len(self.commands)
        serves = (masks[..., None] >> np.arange(count, dtype=np.uint64)) & np.uint64(1) != 0
        return np.where(masks == ALL, 255, np.argmax(serves, axis=-1)).astype(np.uint8)


def core_synthesis(
    group: GridGroup, allowed: Bools, commands: Sequence[Sequence[float]]
) -> SynthesizedCommands:
    """Computes the core K and a table of commands, each held for one period (N = 1).

    `allowed` is a set of the grid's shape; `commands` has up to 64 rows, each with a value of every
    control. States are read without errors, and those of a flow without delay and jitter.
    """
    rows = np.ascontiguousarray(commands, dtype=np.float64)
    assert 1 <= len(rows) <= 64
    assert rows.shape[1] == len(group.inputs.controls), "a value of every control"
    assert group.inputs.delay_ns == 0
    assert group.inputs.jitter_ns == 0
    return _Synthesis(group, allowed, rows).find_table()


HOLDS = (1, 2, 5, 10, 20, 50)
"""The numbers of SC's periods for which a command is held while K is computed; 1 for maps."""
COMMANDS_MAX = 64
"""The largest number of combinations of commands that the engine takes."""
BEGINNING = 1 << 20
"""The number of characters of a file that are read to see whether soter wrote it."""


def synthesize(
    checked: CheckResult,
    output: Path,
    *,
    module: str | None = None,
    system: str | None = None,
    params: Mapping[str, Value] | None = None,
) -> list[Path]:
    """Writes the program with every open safe controller found; returns the files, program first.

    `output` lies in the program's folder, so that its imports and data are found. `SoterError` R...
    where there is no problem, U009 where no controller was found, U001, D006, D008 for `output`.
    """
    assert checked.program is not None
    main = Path(checked.program.path)
    _require_writable_place(main, output)
    written: list[Path] = []
    while True:
        todo = [
            (flat, m)
            for flat, m in modules_of(checked, module, system, params or {})
            if m.symbol.synthesized
        ]
        if not todo:
            return list(dict.fromkeys(written))
        flat, open_module = todo[0]
        if Path(open_module.symbol.span.source.name).name not in (main.name, output.name):
            raise _no_controller_error(
                open_module, "it is declared in an imported file: synthesize it there"
            )
        problem = extract(flat, open_module, synthesize=True)
        program = synthesized_sc.program_with_law(problem, find_law(problem))
        try:
            written += program.save(output)
        except OSError as error:
            message = f"cannot write `{output}`: {reason(error)}"
            raise SoterError((Diagnostic("D006", message),)) from error
        checked = check_file(str(output))
        if not checked.ok:
            raise SoterError(checked.diagnostics.items)


def _is_written_by_soter(output: Path) -> bool:
    """Whether the beginning of the file says that soter wrote the file."""
    try:
        with open_finite_file(output, pipes=False) as stream:
            return synthesized_sc.HEADER.encode() in stream.read(BEGINNING)
    except ReadError:
        return False


def _require_writable_place(main: Path, output: Path) -> None:
    """Raises `SoterError` U001 or D008 if the program cannot be written to `output`."""
    if output.resolve().parent != main.resolve().parent:
        message = f"`{output}` does not lie in the folder of `{main}`"
        helps = ("its imports and data are looked for beside it: choose a name there",)
        raise SoterError((Diagnostic("U001", message, helps=helps),))
    ours = output.resolve() == main.resolve() or not output.exists()
    if not ours and not _is_written_by_soter(output):
        message = f"`{output}` is there already, and soter did not write it"
        helps = ("choose another name with -o, or move it away",)
        raise SoterError((Diagnostic("D008", message, helps=helps),))


MORE = ("give more commands: `commands topic in {-1.0, 0.0, 1.0};`", "or write one")
UNSUPPORTED = ("write a controller of your own: `sc NAME;`",)


def find_law(problem: Problem) -> LawTable:
    """The law for a problem's only group; raises `SoterError` U009 if no law is found."""
    if len(problem.groups) != 1:
        raise _no_controller_error(problem.module, "it has several groups", UNSUPPORTED)
    if problem.parameters or any(e.high > e.low for e in problem.errors):
        why = "parameters and measurement errors are not supported yet"
        raise _no_controller_error(problem.module, why, UNSUPPORTED)
    if len(command_combinations(problem)) > COMMANDS_MAX:
        why = f"there are more than {COMMANDS_MAX} different commands"
        raise _no_controller_error(problem.module, why, ("give fewer values in `commands`",))
    edges = [np.array(a.edges) for a in problem.groups[0].axes]
    widths = [float(e[-1] - e[0]) / (len(e) - 1) for e in edges]
    library, _ = library_of(problem)
    try:
        choices, hold = _commands_with_best_hold(problem, library)
    except UnboundedError as error:
        raise _no_controller_error(problem.module, str(error)) from error
    if not choices.core.any():
        raise _no_controller_error(
            problem.module, "from no cell do the given commands keep the constraint"
        )
    steps = _MovedPoints(problem, library, hold)
    return block_law(choices, [float(e[0]) for e in edges], widths, steps.points_after)


def _no_controller_error(module: Module, why: str, helps: tuple[str, ...] = MORE) -> SoterError:
    symbol = module.symbol
    at = Label(symbol.sc_span, "to be found") if symbol.sc_span is not None else None
    message = f"no safe controller was found for module `{module.name}`"
    return SoterError((Diagnostic("U009", message, at, notes=(why,), helps=helps),))


def _commands_with_best_hold(problem: Problem, library: ReachLibrary) -> tuple[CellCommands, int]:
    """The commands of cells for the hold with the largest K; and the hold, in periods of SC."""
    best: tuple[CellCommands, int] | None = None
    for hold in HOLDS if problem.kind == "flow" else HOLDS[:1]:
        try:
            choices = _commands_for_hold(problem, library, hold)
        except UnboundedError:
            if best is None:
                raise
            break  # too long for an enclosure, and longer ones are too
        if best is None or choices.core.sum() > best[0].core.sum():
            best = choices, hold
    assert best is not None
    return best


def _commands_for_hold(problem: Problem, library: ReachLibrary, hold: int) -> CellCommands:
    commands = command_combinations(problem)
    ranges = [(min(v), max(v)) for v in problem.commands]
    mixed = _engine_with_held_commands(problem, library, ranges, hold)
    core, admits = _core_and_commands(
        mixed, mixed.compute_constraint(hint=problem.has_core_hint), commands
    )
    return CellCommands(core, admits, mixed.cells_safe_for(mixed.inputs.period_ns, core))


def _core_and_commands(
    group: GridGroup, allowed: Bools, commands: Sequence[tuple[float, ...]]
) -> tuple[Bools, Bools]:
    """K and an array (m, *cells): whether command m, held, leads back into K from each cell."""
    table = core_synthesis(group, allowed, commands)
    bits = np.arange(len(commands), dtype=np.uint64).reshape(-1, *[1] * allowed.ndim)
    return table.cells, (table.admits >> bits) & np.uint64(1) != 0


def _engine_with_held_commands(
    problem: Problem, library: ReachLibrary, ranges: Sequence[tuple[float, float]], hold: int
) -> GridGroup:
    """An engine for commands in these ranges, held for `hold` periods, with no delay or jitter."""
    inputs = grid_inputs_of(problem)
    inputs = replace(
        inputs, controls=tuple(ranges), period_ns=hold * inputs.period_ns, delay_ns=0, jitter_ns=0
    )
    axes = [(a.state, a.edges) for a in problem.groups[0].axes]
    return GridGroup(library, inputs, axes)


class _MovedPoints:
    """Computes where points move while a command is held, with all other inputs in mid-range."""

    def __init__(self, problem: Problem, library: ReachLibrary, hold: int) -> None:
        self.problem = problem
        self.forms = CompiledEnclosures(library, problem, ())
        self.commands = command_combinations(problem)
        self.axes = [a.state for a in problem.groups[0].axes]
        middle = self.forms.whole.mean(axis=1)
        self.box: Floats = np.stack([middle, middle], axis=1)
        self.seconds = hold * problem.times.delta_sc * 1e-9

    def points_after(self, command: int, points: Floats) -> Floats:
        """The points (n, d) to which `points` (n, d) move while a command is held once."""
        first = len(self.problem.states)
        for j, value in enumerate(self.commands[command]):
            self.box[first + j] = value
        return np.stack([self._moved_point(p) for p in points])

    def _moved_point(self, point: Floats) -> Floats:
        if self.problem.kind == "map":
            return self._middle_of_results("next", point)
        h = self.seconds
        first = self._middle_of_results("derivative", point)
        half = self._middle_of_results(
            "derivative", point + 0.5 * h * first
        )  # the midpoint rule: a guide
        return point + h * half

    def _middle_of_results(self, name: str, point: Floats) -> Floats:
        self.box[self.axes] = point[:, np.newaxis]
        bounds = self.forms.result_bounds(name, self.box, len(self.problem.states))
        if bounds is None:
            return point if name == "next" else np.zeros_like(point)
        rates: NDArray[np.float64] = bounds.mean(axis=1)[self.axes]
        return rates
