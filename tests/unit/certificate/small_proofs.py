"""Certificates for the tests of the re-checker, made without the prover.

Purpose: a cart between two walls, its tables by a slow fixpoint over images of single cells, and a
writer of folders that takes any manifest, right or wrong.
Non-goals: good sets; speed.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.case_check import CLAIMS, p1c_verdict
from soter.certificate.cell_predicates import certain_cells
from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.grid.group_claims import ChainCheck, FreeCheck, GroupTables
from soter.certificate.proof_methods import parts_without_claim
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.folder import FORMAT, canonical_json
from soter.certificate.reading.module_times import TIME_KEYS
from soter.certificate.reading.problem import read_facts
from soter.certificate.terms.compile_terms import form_of_box
from soter.certificate.terms.linear_enclosures import lower, upper
from soter.language.front_end import check_file, system_to_prove

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts


def facts_of(path: Path, system: str, module: str) -> Facts:
    """The problem of a program."""
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics
    return read_facts(system_to_prove(checked, system), module)


def even_edges(low: float, high: float, cells: int) -> tuple[float, ...]:
    """Breakpoints at equal distances."""
    return (*(low + (high - low) * k / cells for k in range(cells)), high)


class Walk:
    """What SC does with the states of one cell; each step is computed once, whoever asks."""

    def __init__(self, check: ChainCheck, cell: tuple[int, ...]) -> None:
        self.chain, self.n = check.compiled_chain(1), len(check.group.states)
        self.form = form_of_box(
            check.group.grid.box_of(tuple((i, i + 1) for i in cell)), symbols=True
        )
        self.steps: list[Any] = []

    def step(self, k: int) -> Any:
        """The boxes that step `k` sweeps and ends in (None: too far); None where there is no step.

        All steps before it have been asked for.
        """
        if k == len(self.steps):
            after = (self.chain.later if k else self.chain.first)(self.form)
            self.steps.append(after and (after[1], self._ends(after[0])))
            self.form = after[0] if after else ()
        return self.steps[k]

    def _ends(self, form: Any) -> Any:
        if self.chain.last is not None:
            return self.chain.last(form)
        ends = [(form[2 * i], form[2 * i + 1]) for i in range(self.n)]
        return None, tuple(x for lo, hi in ends for x in (lower(lo), upper(hi)))


Walks = dict[tuple[int, ...], Walk]


def images(
    check: ChainCheck, within: Cells, holds_max: int, walks: Walks, of: np.ndarray
) -> dict[int, list[Any]]:
    """For each cell of a set and each number of holds the box reached, while all stays within."""
    images_by_cell: dict[int, list[Any]] = {}
    for at, cell in enumerate(np.ndindex(of.shape)):
        row = images_by_cell[at] = []
        if not of[cell]:
            continue
        walk = walks.get(cell) or walks.setdefault(cell, Walk(check, cell))
        for k in range(holds_max):
            step = walk.step(k)
            if step is None or not within.contains_all(step[0]):
                break
            last = step[1]
            if check.compiled_chain(1).last is not None and not (
                last and within.contains_all(last[1])
            ):
                last = None
            row.append(last and last[1])
    return images_by_cell


def kernel(check: ChainCheck, within: Cells, holds_max: int, walks: Walks) -> np.ndarray:
    """Witnesses of the greatest set that SC keeps within another one."""
    grid = check.group.grid
    boxes = images(check, within, holds_max, walks, within.members)
    members = within.members.copy()
    while True:
        cells = Cells(grid, members)
        witnesses = np.zeros(grid.shape, dtype=np.uint8)
        for at, cell in enumerate(np.ndindex(grid.shape)):
            if members[cell]:
                for k in range(len(boxes[at]) - 1, -1, -1):
                    if boxes[at][k] is not None and cells.contains(boxes[at][k]):
                        witnesses[cell] = k + 1
                        break
        if ((witnesses > 0) == members).all():
            return witnesses
        members = witnesses > 0


def ranks(check: ChainCheck, home: Cells, core: np.ndarray, holds_max: int, walks: Walks) -> Any:
    """Ranks and their witnesses."""
    grid = check.group.grid
    everywhere = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    boxes = images(check, everywhere, holds_max, walks, core)
    rank = np.zeros(grid.shape, dtype=np.uint16)
    holds = np.zeros(grid.shape, dtype=np.uint8)
    done, level = home.members.copy(), 1
    rank[home.members] = 1
    while True:
        level += 1
        cells, fresh = Cells(grid, done), []
        for at, cell in enumerate(np.ndindex(grid.shape)):
            if core[cell] and not done[cell]:
                for k, box in enumerate(boxes[at]):
                    if box is not None and cells.contains(box):
                        fresh.append((cell, k + 1))
                        break
        if not fresh:
            return rank, holds
        for cell, k in fresh:
            done[cell], rank[cell], holds[cell] = True, level, k


def prove(facts: Facts, shape: tuple[tuple[int, ...], ...], holds_max: int = 40) -> dict[str, Any]:
    """Manifest entry of a module with one group, and its tables as `sets`."""
    extents = tuple(facts.axes[i] for i in range(len(facts.states)))
    entry: dict[str, Any] = {
        "module": facts.module.name,
        "plants": [c.name for c in facts.plants],
        "parameters": [{"name": p.name, "values": list(p.values)} for p in facts.parameters],
        "times": {k: facts.times[k] for k in TIME_KEYS},
        "inputs": [
            {
                "name": s.name,
                "kind": s.kind,
                "low": (extents[i][0] if i < len(extents) else s.low).hex(),
                "high": (extents[i][1] if i < len(extents) else s.high).hex(),
            }
            for i, s in enumerate(
                [
                    *facts.states,
                    *facts.controls,
                    *facts.disturbances,
                    *facts.errors,
                    *facts.others,
                ]
            )
        ],
        "claims": dict.fromkeys(CLAIMS[:-1], "proved")
        | {"P1c": p1c_verdict(facts)},  # it has no law
        "recover_ns": None,
        "cases": [],
    }
    sets: dict[str, bytes] = {}
    groups_of = [tuple(range(len(facts.states)))]
    for k, values in enumerate(facts.parameter_combinations()):
        model = CaseModel(facts, values, extents)
        grid = Grid(tuple(even_edges(*extents[i], n) for i, n in enumerate(shape[0])))
        none = np.zeros(grid.shape, dtype=np.uint8)
        group = GroupTables(groups_of[0], grid, none)
        safe = certain_cells(model, [group], facts.symbol.safe, errors=False)[0]
        check = ChainCheck(model, group)
        walks: Walks = {}
        core = kernel(check, safe, holds_max, walks)
        cells = Cells(grid, core > 0)
        phase = FreeCheck(model, group, facts.times["H_ns"])
        free = np.zeros(grid.shape, dtype=np.bool_)
        for cell in np.ndindex(grid.shape):
            box = grid.box_of(tuple((i, i + 1) for i in cell))
            free[cell] = bool(core[cell]) and phase.stays_in(box, cells, 4)
        assert facts.symbol.safer is not None
        calm = certain_cells(model, [group], facts.symbol.safer, errors=True)[0]
        home = kernel(check, calm, holds_max, walks)
        rank, holds = ranks(check, Cells(grid, home > 0), core, holds_max, walks)
        stem = f"sets/{k}_"
        tables = {
            "K": core.tobytes(),
            "R": np.packbits(free.reshape(-1), bitorder="little").tobytes(),
            "Q": home.tobytes(),
            "W": rank.astype("<u2").tobytes(),
            "W_N": holds.tobytes(),
        }
        axes = []
        for i, edges in enumerate(grid.edges):
            sets[f"{stem}axis{i}.bin"] = np.array(edges, dtype="<f8").tobytes()
            axes.append({"state": facts.states[i].name, "edges": f"{stem}axis{i}.bin"})
        sets.update({f"{stem}{n}.bin": data for n, data in tables.items()})
        named = {n: f"{stem}{n}.bin" for n in tables}
        entry["cases"].append(
            {"parameter": list(values), "groups": [{"kind": "grid", "axes": axes, **named}]}
        )
    return {"entry": entry, "sets": sets}


def write(
    folder: Path, program: dict[str, str], main: str, entries: list[Any], sets: dict[str, bytes]
) -> None:
    """A sealed folder of whatever it is given."""
    files = {f"program/{n}": text.encode() for n, text in program.items()} | sets
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    checked = check_file(str(folder / "program" / main))
    manifest = {
        "schema": FORMAT,
        "files": {n: hashlib.sha256(d).hexdigest() for n, d in files.items()},
        "main": main,
        "params": {},
        "program_sha256": checked.program.sha256 if checked.program else "",
        "modules": entries,
    }
    seal(folder, manifest)


def seal(folder: Path, manifest: Any) -> None:
    """Write manifest and seal."""
    raw = canonical_json(manifest)
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")


def reseal(folder: Path, manifest: Any) -> None:
    """Every hash anew."""
    for name in manifest["files"]:
        manifest["files"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    seal(folder, manifest)


def only_claimed(folder: Path, manifest: Any) -> None:
    """Take out of a certificate what none of its claims rests on; to be sealed again."""
    for entry in manifest["modules"]:
        claims = {n for n, verdict in entry["claims"].items() if verdict == "proved"}
        for group in (g for case in entry["cases"] for g in case["groups"]):
            names = parts_without_claim(group, claims, computed="tables" in entry)
            for name in names:
                path = group.pop(name)
                del manifest["files"][path]
                (folder / path).unlink()
        if "P2b" not in claims:
            entry["recover_ns"] = None


def edit_program(folder: Path, *pairs: tuple[str, str]) -> Any:
    """Replace texts in the program of a certificate, hashes right; the manifest."""
    manifest = json.loads((folder / "manifest.json").read_text())
    path = folder / "program" / manifest["main"]
    text = path.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text)
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics.items
    assert checked.program is not None
    manifest["program_sha256"] = checked.program.sha256
    reseal(folder, manifest)
    return manifest
