"""What `soter verify` says about a random module, and the start and predicates that fit its sets.

Purpose: `prove(module)`: the verdict and the machine with the predicates that the DM would hold;
`widened`: the same module with the largest start, `written` with hand-written predicates as bold
as the sets allow. Both read the prover's sets, to stand as close to a border as can be proved.
Non-goals: the attack (`closed_loop.py`).
"""

from __future__ import annotations

import signal
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
from bench.adversary.random_modules import Face, GroupOfTables, Module, with_tables

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify import verify_module
from soter.verify.claims.results import PROVED, Finding
from soter.verify.grid.group_model import UnboundedError
from soter.verify.problem.extract import extract
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    import numpy.typing as npt
    from bench.adversary.closed_loop import Machine

    from soter.verify.claims.results import GroupSets, ModuleResult
    from soter.verify.grid.sets import GridGroup

    Array = npt.NDArray[np.float64]
    Bools = npt.NDArray[np.bool_]

CPU_S = 12.0
"""What one proof may take; a module that takes longer is left out."""
SAFETY = ("P1a", "P1b", "P2a", "P3", "ttf", "safer", "start", "DM")


@dataclass
class Proof:
    """`verdict` as printed; `safe`: every claim that safety needs is proved."""

    module: Module
    verdict: str
    safe: bool
    why: str
    result: ModuleResult | None = None

    @property
    def proved(self) -> bool:
        """The headline."""
        return self.verdict == "proved"


class _TooLongError(Exception):
    """The processor time for one proof is over."""


def _over(*_: object) -> None:
    raise _TooLongError


def prove(module: Module, *, whole: bool = True, seconds: float = CPU_S) -> Proof:
    """Verify the module's text within so much processor time; `whole`: with the check of the DM."""
    signal.signal(signal.SIGPROF, _over)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        return _prove(module) if whole else _sets_only(module)
    except _TooLongError:
        return Proof(module, "undecided", False, f"not within {seconds:g} s")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _sets_only(module: Module) -> Proof:
    """Without compiling the DM: for what only looks for a better start."""
    with patch.object(verify_module, "_dm_finding", lambda _: Finding(PROVED)):
        return _prove(module)


def _prove(module: Module) -> Proof:
    checked = check_file("adversary.soter", module.text)
    if not checked.ok:
        first = checked.diagnostics.items[0]
        return Proof(module, "refused", False, f"{first.code} {first.message}")
    flat = system_of(checked, "S")
    try:
        result = verify_module.verify_module(extract(flat, flat.modules[0]), refute=False)
    except SoterError as error:
        first = error.diagnostics[0]
        return Proof(module, "refused", False, f"{first.code} {first.message}")
    except UnboundedError as error:
        return Proof(module, "undecided", False, str(error))
    held = result.findings["P1c"].verdict in ("proved", "assumed")
    safe = held and all(result.findings[p].verdict == "proved" for p in SAFETY)
    wrong = [f"{p}: {f.text}" for p, f in result.findings.items() if not f.holds]
    return Proof(module, result.verdict, safe, "; ".join(wrong)[:200], result)


def armed(proof: Proof) -> Machine:
    """The machine with the predicates of the proof."""
    module, result = proof.module, proof.result
    machine = module.machine()
    if module.ttf or result is None:
        return machine
    case = result.cases[0]
    with_tables(machine, [_tables(part) for part in case.groups])
    if module.shield:
        machine.c.shield, machine.c.toward = module.shield, module.toward
        machine.c.acted = result.problem.times.replaced_window // (module.tick_us * 1000)
    return machine


def _tables(part: GroupSets) -> GroupOfTables:
    """What the DM holds of a group."""
    assert part.deployed is not None
    order = np.argsort([a.state for a in part.group.axes])
    sure, inner_cells = (np.transpose(cells, order) for cells in part.deployed)
    states = tuple(part.group.axes[k].state for k in order)
    edges = [np.array(part.group.axes[k].edges) for k in order]
    levels = sure.astype(np.uint8) + (inner_cells & sure)
    if part.tops is None:
        return GroupOfTables(states, edges, levels)
    others = range(len(order), part.tops.ndim)
    moved = () if part.command is None else (part.command,)
    tops, lasting = (
        None if x is None else np.transpose(x, (*order, *others)) for x in (part.tops, part.lasting)
    )
    return GroupOfTables(states, edges, levels, tops, moved, lasting)


# ---------------------------------------------------------------- a start at the border


def widened(proof: Proof, rng: np.random.Generator) -> Module:
    """The module with a start that reaches as far as R(h_0) does, in some proportion."""
    module, result = proof.module, proof.result
    assert result is not None
    if len(result.cases[0].groups) != 1:
        return replace(module, start=tuple(0.2 * v for v in module.box))
    part = result.cases[0].groups[0]
    engine: GridGroup = part.solver  # type: ignore[assignment]
    h0 = result.problem.whole_periods(result.problem.times.start)
    inside = engine.cells_safe_for(h0, part.core > 0)
    order = np.argsort([a.state for a in part.group.axes])
    inside = np.transpose(inside, order)
    edges = [np.array(part.group.axes[k].edges) for k in order]
    best, most = module.starts, 0.0
    for _ in range(12):
        shape = np.array(module.box) * rng.uniform(0.1, 1.0, module.n)
        low, high = 0.0, 1.0
        for _ in range(12):
            mid = 0.5 * (low + high)
            low, high = (mid, high) if _holds(inside, edges, mid * shape) else (low, mid)
        size = float(np.prod(low * shape / np.array(module.box))) * rng.uniform(0.5, 1.0)
        if size > most:
            most, best = size, tuple(float(f"{v:.4g}") * 0.9995 for v in low * shape)
    return replace(module, start=best)


def _holds(inside: Bools, edges: list[Array], half: Array) -> bool:
    at = []
    for e, h in zip(edges, half, strict=True):
        first, last = np.searchsorted(e, -h, "right") - 1, np.searchsorted(e, h, "left")
        if first < 0 or last > len(e) - 1:
            return False
        at.append(slice(first, max(last, first + 1)))
    return bool(inside[tuple(at)].all())


# ---------------------------------------------------------------- predicates at the border


def written(proof: Proof, rng: np.random.Generator, *, hysteresis: float = 0.0) -> Module | None:
    """Hand-written predicates whose `not ttf` is as large as R(H) lets it be; None: none fits."""
    module, result = proof.module, proof.result
    assert result is not None
    if len(result.cases[0].groups) != 1 or module.n > 2:
        return None
    part = result.cases[0].groups[0]
    assert part.free is not None
    engine: GridGroup = part.solver  # type: ignore[assignment]
    order = np.argsort([a.state for a in part.group.axes])
    free = np.transpose(part.free, order)
    edges = [np.array(part.group.axes[k].edges) for k in order]
    possible = np.transpose(engine.cells_maybe_true("safe"), order)
    errors = errors_by_state(result.problem)
    spans = []
    for i, e in enumerate(edges):
        extra = errors.get(i, 0.0) * 1.001 + 1e-9
        spans.append((e[:-1] - extra, e[1:] + extra))
    if not free.any():
        return None
    best: tuple[float, list[Face]] | None = None
    for _ in range(24):
        faces = _faces(module, rng)
        least = [_least(f, spans) for f in faces]
        base = np.array([max(float(v[free].max()), 1e-9) * rng.uniform(0.4, 1.0) for v in least])
        apart = np.max([v / b for v, b in zip(least, base, strict=True)], axis=0)
        bad = possible & ~free
        scale = float(apart[bad].min()) if bad.any() else 1.0
        if scale <= 0.0:
            continue
        held = float((apart < scale).mean()) * rng.uniform(0.7, 1.0)
        if best is None or held > best[0]:
            limits = base * scale * 0.999
            best = (
                held,
                [replace(f, limit=float(f"{v:.6g}")) for f, v in zip(faces, limits, strict=True)],
            )
    if best is None:
        return None
    safer = tuple(replace(f, limit=f.limit * (1.0 - hysteresis)) for f in best[1])
    return replace(module, ttf=tuple(best[1]), safer=safer)


def _faces(module: Module, rng: np.random.Generator) -> list[Face]:
    if module.n == 1:
        return [Face((1.0,), 0.0, 1.0)]
    speed = module.box[0] / max(module.box[1], 1e-9)
    look = float(f"{rng.choice([0.0, 0.1, 0.3, 1.0]) * speed * rng.random():.3g}")
    bend = float(f"{rng.choice([0.0, 0.5, 1.0]) * speed / module.box[1] * rng.random():.3g}")
    return [Face((1.0, look), bend, 1.0), Face((0.0, 1.0), 0.0, 1.0)]


def _least(face: Face, spans: list[tuple[Array, Array]]) -> Array:
    """The least |face| over each cell with its errors; the face grows with every state."""
    low, high = np.zeros(()), np.zeros(())
    for i, (a, b) in enumerate(spans):
        shape = [1] * len(spans)
        shape[i] = len(a)
        bent = [v * face.a[i] + (face.bend * v * np.abs(v) if i == 1 else 0.0) for v in (a, b)]
        low, high = low + bent[0].reshape(shape), high + bent[1].reshape(shape)
    return np.asarray(np.where(low > 0.0, low, np.where(high < 0.0, -high, 0.0)))
