"""Certificates made wrong and sealed again.

    .venv/bin/python bench/recheck/corruptions.py [--count 1000] [--seed 1] [--drag 0.3]

Purpose: take a certificate of the cart of `models.py`, change something (sets enlarged,
witnesses changed, bounds, Delta, H, disturbance or error changed, the grid shifted, the program
with the manifest adapted), write every hash anew, and let `soter recheck` judge. What it accepts is
attacked by simulation: one that is accepted while some run breaks a claim is the one
thing that must not happen.
Non-goals: bytes changed without new hashes (tests/unit/certificate).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.recheck.models import Attack, Cart, Tables  # noqa: E402 - needs the path
from bench.recheck.sealing import fit, seal, write  # noqa: E402 - the same

from soter.certificate.reading.folder import (  # noqa: E402
    FORMAT,
)
from soter.certificate.reading.module_facts import DiffersError  # noqa: E402
from soter.certificate.reading.module_times import TIME_KEYS  # noqa: E402
from soter.certificate.reading.problem import read_facts  # noqa: E402
from soter.certificate.rechecker import recheck  # noqa: E402
from soter.language.front_end import check_file, system_of  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from numpy.typing import NDArray

    Made: TypeAlias = "tuple[Sealed, dict[str, NDArray[Any]]] | None"

KINDS = {"K": "<u1", "R": "bits", "Q": "<u1", "W": "<u2", "W_N": "<u1"}
MAIN = "cart.soter"


@dataclass
class Sealed:
    """A certificate in memory: the cart, the manifest's module, tables and edges as arrays."""

    cart: Cart
    entry: dict[str, Any]
    tables: dict[str, NDArray[Any]]
    edges: list[NDArray[np.float64]]
    main: str = MAIN
    text: str = ""
    adapt: bool = False
    """Whether inputs and times are to be taken from the changed program."""
    extra: dict[str, Any] = field(default_factory=dict)

    def copy(self) -> Sealed:
        """Deep enough to be changed."""
        return replace(
            self,
            entry=json.loads(json.dumps(self.entry)),
            tables={k: v.copy() for k, v in self.tables.items()},
            edges=[e.copy() for e in self.edges],
        )

    def as_tables(self) -> Tables:
        """For simulations."""
        t = self.tables
        edges = (self.edges[0], self.edges[1])
        return Tables(edges, t["K"], t["R"], t["Q"], t["W"], t["W_N"])

    # ------------------------------------------------------------ folders

    def write(self, folder: Path) -> None:
        """The folder, every hash right."""
        group = self.entry["cases"][0]["groups"][0]
        text = self.text or self.cart.text()
        files = {f"program/{self.main}": text.encode()}
        for name, kind in KINDS.items():
            table = self.tables[name]
            if kind == "bits":
                data = np.packbits(table.reshape(-1).astype(bool), bitorder="little").tobytes()
            else:
                data = table.astype(kind).tobytes()
            files[group[name]] = data
        for axis, edges in zip(group["axes"], self.edges, strict=True):
            files[axis["edges"]] = edges.astype("<f8").tobytes()
        write(folder, files)
        checked = check_file(str(folder / "program" / self.main))
        if self.adapt and checked.ok:
            with contextlib.suppress(DiffersError):
                fit(self.entry, read_facts(system_of(checked, "Track"), "SafeCart"))
        manifest = {
            "schema": FORMAT,
            "main": self.main,
            "params": {},
            "program_sha256": checked.program.sha256 if checked.program else "",
            "modules": [self.entry],
            **self.extra,
        }
        seal(folder, manifest, files)


def read(folder: Path, cart: Cart) -> Sealed:
    """The certificate that `soter verify` made of a cart."""
    manifest = json.loads((folder / "manifest.json").read_text())
    (entry,) = manifest["modules"]
    group = entry["cases"][0]["groups"][0]
    edges = [np.fromfile(folder / a["edges"], dtype="<f8") for a in group["axes"]]
    shape = tuple(len(e) - 1 for e in edges)
    tables = {}
    for name, kind in KINDS.items():
        data = np.fromfile(folder / group[name], dtype="<u1" if kind == "bits" else kind)
        if kind == "bits":
            data = np.unpackbits(data, bitorder="little")[: shape[0] * shape[1]]
        tables[name] = data.reshape(shape)
    return Sealed(cart, entry, tables, edges)


# ---------------------------------------------------------------- corruptions


def _border(members: NDArray[np.bool_]) -> NDArray[Any]:
    """Cells outside a set beside one of it."""
    beside = np.zeros_like(members)
    for axis in (0, 1):
        for shift in (1, -1):
            moved = np.roll(members, shift, axis)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
            moved[tuple(edge)] = False
            beside |= moved
    return np.argwhere(beside & ~members)


def _enlarged(s: Sealed, name: str, draw: np.random.Generator) -> Made:
    table = s.tables[name]
    near = draw.random() < 0.7
    cells = _border(table > 0) if near else np.argwhere(table == 0)
    if len(cells) == 0:
        return None
    chosen = cells[draw.integers(len(cells), size=int(draw.choice([1, 1, 2, 5, 20])))]
    for i, j in chosen:
        beside = table[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
        table[i, j] = max(int(beside.max()), 1)
        if name == "W" and s.tables["W_N"][i, j] == 0:
            s.tables["W_N"][i, j] = int(draw.integers(1, 30))
    return s, {name: chosen}


def _witness(s: Sealed, name: str, draw: np.random.Generator) -> Made:
    table = s.tables[name]
    cells = np.argwhere(table > 0)
    chosen = cells[draw.integers(len(cells), size=int(draw.choice([1, 3, 10])))]
    for i, j in chosen:
        old = int(table[i, j])
        table[i, j] = max(1, min(255, int(draw.choice([1, old - 1, old + 1, 2 * old, 5]))))
    claim = "W" if name == "W_N" else name
    return s, {claim: chosen}


def _lower_rank(s: Sealed, draw: np.random.Generator) -> Made:
    cells = np.argwhere(s.tables["W"] > 1)
    if len(cells) == 0:
        return None
    chosen = cells[draw.integers(len(cells), size=int(draw.choice([1, 3, 10])))]
    for i, j in chosen:
        rank = int(s.tables["W"][i, j])  # a cell may be drawn twice, and be at 1 already
        s.tables["W"][i, j] = int(draw.integers(1, rank)) if rank > 1 else rank
    return s, {"W": chosen}


def _moved_table(s: Sealed, draw: np.random.Generator) -> Made:
    name = str(draw.choice(["K", "R", "Q"]))
    axis, shift = int(draw.integers(2)), int(draw.choice([-1, 1]))
    s.tables[name] = np.roll(s.tables[name], shift, axis)
    return s, {}


def _grid(s: Sealed, draw: np.random.Generator) -> Made:
    axis = int(draw.integers(2))
    edges = s.edges[axis]
    width = edges[1] - edges[0]
    how = str(draw.choice(["shift", "scale", "inner", "one"]))
    if how == "shift":
        s.edges[axis] = edges + width * draw.choice([-1.0, -0.3, 0.01, 0.3, 1.0])
    elif how == "scale":
        s.edges[axis] = edges * draw.choice([0.9, 0.99, 1.01, 1.1])
    elif how == "inner":
        s.edges[axis][1:-1] += width * draw.choice([-0.9, -0.3, 0.1, 0.5])
    else:
        k = int(draw.integers(1, len(edges) - 1))
        s.edges[axis][k] += width * draw.choice([-0.9, -0.3, 0.3, 0.9])
    if how in ("shift", "scale"):
        s.entry["inputs"][axis]["low"] = float(s.edges[axis][0]).hex()
        s.entry["inputs"][axis]["high"] = float(s.edges[axis][-1]).hex()
        if draw.random() < 0.5:  # the program adapted as well
            low, high = (float(s.edges[axis][k]) for k in (0, -1))
            old = ("motion.x in [-2.0, 2.0]", "motion.v in [-2.5, 2.5]")[axis]
            new = f"{old[:8]} in [{low!r}, {high!r}]"
            s.text = s.cart.text().replace(old, new)
    return s, {}


def _figures(s: Sealed, draw: np.random.Generator) -> Made:
    """The manifest says other figures than the program."""
    if draw.random() < 0.5:
        key = str(draw.choice(TIME_KEYS))
        s.entry["times"][key] += int(draw.choice([-1, 1, 10**6, -(10**6), 10**7]))
    else:
        item = s.entry["inputs"][int(draw.integers(len(s.entry["inputs"])))]
        side = str(draw.choice(["low", "high"]))
        factor = float(draw.choice([0.5, 0.9, 1.0000001, 1.1]))
        item[side] = (float.fromhex(item[side]) * factor).hex()
    return s, {}


CHANGES: dict[str, tuple[float, ...]] = {
    "wind": (0.11, 0.15, 0.3, 1.0),
    "e_x": (0.011, 0.02, 0.1),
    "e_v": (0.021, 0.04, 0.2),
    "a": (3.1, 3.5, 6.0, 2.5, 2.0),
    "wall": (1.99, 1.9, 1.5),
    "k_x": (-2.0, 0.0, 1.0, 4.0, 8.0),
    "k_v": (-2.5, 0.0, 1.0, 2.0, 4.0, 12.0),
    "age": (25, 30, 45),
    "late": (3, 5, 10),
    "period": (100, 150),
    "delta": (25, 40),
    "brake": (4.2, 5.0, 8.0),
    "room": (1.31, 1.4, 1.6, 2.0),
    "tau": (0.149, 0.12, 0.08, 0.0),
    "tau_safer": (0.24, 0.2, 0.1),
    "start": (0.2, 0.5, 1.0, 1.5),
    "drag": (0.02, 0.1, 0.5),
}


def _program(s: Sealed, draw: np.random.Generator) -> Made:
    """Another program, and a manifest that fits it; the sets are those of the old one."""
    name = str(draw.choice(list(CHANGES)))
    value = float(draw.choice(CHANGES[name]))
    figures: dict[str, Any] = {name: int(value)}
    if isinstance(getattr(s.cart, name), float):
        figures[name] = round(value * float(draw.uniform(0.98, 1.02)), 6)
    s.cart = replace(s.cart, **figures)
    s.adapt = True
    return s, {}


def _structure(s: Sealed, draw: np.random.Generator) -> Made:
    """Something is missing, doubled, or out of order."""
    group = s.entry["cases"][0]["groups"][0]
    how = int(draw.integers(7))
    if how == 0:
        group["axes"].reverse()
        s.edges.reverse()
    elif how == 1:
        s.entry["cases"] = s.entry["cases"] * 2
    elif how == 2:
        group["axes"][1]["state"] = group["axes"][0]["state"]
    elif how == 3:
        s.entry["inputs"].reverse()
    elif how == 4:
        s.entry["recover_ns"] = 10**6
    elif how == 5:
        s.entry["system"] = "Nowhere"
    else:
        s.extra["schema"] = FORMAT + 1
    return s, {}


CORRUPTIONS: dict[str, tuple[int, Callable[[Sealed, np.random.Generator], Any]]] = {
    "K enlarged": (14, lambda s, d: _enlarged(s, "K", d)),
    "R enlarged": (12, lambda s, d: _enlarged(s, "R", d)),
    "Q enlarged": (8, lambda s, d: _enlarged(s, "Q", d)),
    "W enlarged": (4, lambda s, d: _enlarged(s, "W", d)),
    "witness of K": (8, lambda s, d: _witness(s, "K", d)),
    "witness of Q": (5, lambda s, d: _witness(s, "Q", d)),
    "witness of W": (4, lambda s, d: _witness(s, "W_N", d)),
    "rank lowered": (4, _lower_rank),
    "table moved": (4, _moved_table),
    "grid moved": (8, _grid),
    "figures of the manifest": (8, _figures),
    "program changed": (18, _program),
    "structure": (3, _structure),
}


@dataclass(frozen=True)
class Outcome:
    """What became of a corruption."""

    kind: str
    accepted: bool
    reason: str
    broken: str


def corrupt(base: Sealed, seed: int) -> tuple[str, Sealed, dict[str, Any]]:
    """The corruption with this number."""
    draw = np.random.default_rng(seed)
    kinds = list(CORRUPTIONS)
    weights = np.array([CORRUPTIONS[k][0] for k in kinds], dtype=float)
    while True:
        kind = str(draw.choice(kinds, p=weights / weights.sum()))
        made = CORRUPTIONS[kind][1](base.copy(), draw)
        if made is not None:
            return kind, made[0], made[1]


def judge(base: Sealed, seed: int) -> Outcome:
    """Corrupt, seal, recheck; attack what was accepted."""
    kind, wrong, suspects = corrupt(base, seed)
    folder = Path(tempfile.mkdtemp(prefix="corrupted-"))
    try:
        wrong.write(folder)
        report = recheck(folder, workers=1)
    finally:
        shutil.rmtree(folder)
    broken = ""
    if report.accepted:
        broken = Attack(wrong.cart, wrong.as_tables(), seed).broken(suspects)
    return Outcome(kind, report.accepted, report.reason, broken)


def make_base(folder: Path, drag: float = 0.0) -> Sealed:
    """The certificate that everything starts from."""
    import soter  # noqa: PLC0415 - only here

    cart = Cart(drag=drag)
    path = folder / MAIN
    path.write_text(cart.text())
    soter.load(path).verify(cert=folder / "cert", refute=False)
    return read(folder / "cert", cart)


_BASE: list[Sealed] = []


def _judge(seed: int) -> Outcome:
    return judge(_BASE[0], seed)


def run(count: int, seed: int, jobs: int, drag: float = 0.0) -> list[Outcome]:
    """So many corruptions."""
    with tempfile.TemporaryDirectory() as name:
        _BASE[:] = [make_base(Path(name), drag)]
    clean = Attack(_BASE[0].cart, _BASE[0].as_tables(), seed).broken({}, 20_000)
    assert not clean, f"the untouched certificate is broken: {clean}"
    seeds = range(seed * 1_000_000, seed * 1_000_000 + count)
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        return list(pool.imap(_judge, seeds, chunksize=8))


def main() -> int:
    """Print the table; exit 1 where something false was accepted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--drag", type=float, default=0.0, help="1/m: a flow that is not linear")
    args = parser.parse_args()
    began = time.perf_counter()
    outcomes = run(args.count, args.seed, args.jobs, args.drag)
    kinds = Counter(o.kind for o in outcomes)
    heads = ("count", "rejected", "accepted, true", "accepted, FALSE")
    print(f"{'corruption':<26}{heads[0]:>7}{heads[1]:>10}{heads[2]:>16}{heads[3]:>17}")
    for kind in CORRUPTIONS:
        of = [o for o in outcomes if o.kind == kind]
        true = sum(o.accepted and not o.broken for o in of)
        false = sum(bool(o.accepted and o.broken) for o in of)
        print(f"{kind:<26}{kinds[kind]:>7}{len(of) - true - false:>10}{true:>16}{false:>17}")
    wrong = [o for o in outcomes if o.accepted and o.broken]
    rejected = sum(not o.accepted for o in outcomes)
    true = len(outcomes) - rejected - len(wrong)
    print(f"{'all':<26}{len(outcomes):>7}{rejected:>10}{true:>16}{len(wrong):>17}")
    print(f"{time.perf_counter() - began:.0f} s, target: 0 accepted and false")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
