"""Wrong stacks: what each is, and how it is laid out, verified, flown and flown again.

Purpose: `Wrong` (texts that become others, what has to be verified, where it is flown), `verdict`
and `refuted`. A refutation is a flight of the changed program, found by the compiled program and
flown again from its seed by the reference interpreter: the same property is violated at the same
time, and the states up to then have the same hash. `WRONG` are changes that are unsafe in a world
that is named with them, or say why no flight can show that; `ASSUMED` break what the proofs take
for granted of the program: those are proved, and the verdict has to name what they break. Beside
what bench/rows.py says of the text: a section is a kind, a row `NAME: WORDS`; `in` is the file that
is changed where an edit names none, `verify` and `?` are `Wrong.verify` and `Wrong.assumed`,
`flown` is one of `WORLDS`, `no` is `Wrong.why`.
Non-goals: tables (`wrong_stacks.py`).
"""

from __future__ import annotations

import math
import re
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bench.rows import Groups, edited, edits_of, rows

from soter import SoterError
from soter.api import load
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of, refuse_forced_modules
from soter.verify.claims import results
from soter.verify.problem.problem import assumption_texts
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from bench.rows import Row

    from soter.api import Program
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.language.model.system import Module, System
    from soter.simulate.result import Run

ROOT = Path(__file__).resolve().parents[2]
DRONE = "examples/drone"
WORLD_FILES = ("drone_wrong_battery", "drone_wrong_planner", "drone_wrong_corridor")
AFTER_S = 0.05
"""How much longer than until its violation a flight is repeated."""
TURNS = 4
"""Six views in the order east, above, west, below, north, south: two kinds of wall first."""
SOON_S = 6.0
"""A flight that violates so early is not worth a shorter one."""
AGAIN_S = 90.0
"""Longest flight that the interpreter is given: it is some ten times slower than the drone."""


@dataclass(frozen=True)
class Edit:
    """`old` occurs in the file (below `examples/drone/`) and becomes `new`, wherever it stands."""

    file: str
    old: str
    new: str


@dataclass(frozen=True)
class World:
    """A system that is admissible: flown until `until_s` from each seed.

    `file`: below the root. `shows`: part of the property that a wrong stack violates. `narrowed`:
    edits after which the environment may do less (a disturbance that stays at its bound), so what
    then happens may happen without them.
    """

    file: str
    system: str
    until_s: float
    shows: str
    seeds: int = 6
    params: tuple[tuple[str, float], ...] = ()
    narrowed: tuple[Edit, ...] = ()

    @property
    def name(self) -> str:
        """For the table."""
        return f"{Path(self.file).stem.removeprefix('drone_wrong_')}.{self.system}"


@dataclass(frozen=True)
class Wrong:
    """A changed stack that is unsafe in an admissible world.

    `verify`: the file below `examples/drone/` that is verified, and the module (None: all of them,
    and the conjunction). `worlds`: in turn, until one shows it. `why`: why no flight can.
    `assumed`: a pattern of what the verdict prints where what is broken is assumed and not proved;
    empty where it must not be proved.
    """

    kind: str
    name: str
    words: str
    edits: tuple[Edit, ...]
    verify: tuple[str, str | None]
    worlds: tuple[World, ...] = ()
    why: str = ""
    assumed: str = ""


@dataclass(frozen=True)
class Verdict:
    """What `verify` says: `proved` by itself or together; `text` for the table."""

    proved: bool
    text: str
    seconds: float
    assumptions: tuple[str, ...] = ()


@dataclass(frozen=True)
class Refutation:
    """A flight that violates, and whether the interpreter repeats it."""

    world: World
    seed: int
    what: str
    at_s: float
    repeated: bool


@dataclass(eq=False)
class Tree:
    """Copies of the drone and of the worlds, with edits."""

    folder: Path
    programs: dict[str, Program] = field(default_factory=dict)

    def program(self, file: str) -> Program:
        """The loaded program of a file below the root."""
        if file not in self.programs:
            self.programs[file] = load(self.folder / file)
        return self.programs[file]


def laid_out(folder: Path, edits: Iterable[Edit]) -> Tree:
    """The changed stack in `folder`; AssertionError where a text to be changed is not there."""
    ignored = shutil.ignore_patterns("__pycache__", ".soter")
    shutil.copytree(ROOT / DRONE, folder / DRONE, ignore=ignored)
    (folder / "bench" / "drone").mkdir(parents=True)
    for name in WORLD_FILES:
        shutil.copy(ROOT / "bench" / "drone" / f"{name}.soter", folder / "bench" / "drone")
    for edit in edits:
        path = folder / DRONE / edit.file
        path.write_text(changed(path.read_text(encoding="utf-8"), edit), encoding="utf-8")
    return Tree(folder)


def changed(text: str, edit: Edit) -> str:
    """The text of a file after an edit of it."""
    return edited(text, ((edit.old, edit.new),), most=math.inf)


# ---------------------------------------------------------------- the verifier


def verdict(tree: Tree, verify: tuple[str, str | None]) -> Verdict:
    """What `soter verify` says, without looking for counterexamples.

    Views and modules in turn, until one of them is not proved: then the rest says nothing new.
    """
    began = time.perf_counter()
    file, module = verify
    told: list[str] = []
    names: list[str] = []
    try:
        checked = check_file(str(tree.folder / DRONE / file))
        if not checked.ok:
            return refusal(checked.diagnostics.items, began)
        chosen = modules_of(checked, module, None, {})
        refuse_forced_modules(chosen)
        problems = problems_of(views_of(chosen))
        for problem in (p for _, p in sorted(enumerate(problems), key=lambda e: e[0] % TURNS)):
            module_result = verify_module(problem, refute=False)
            name = module_result.name.rpartition(".")[2]
            if module_result.verdict not in (results.PROVED, results.ASSUMED):
                open_ = ", ".join(c for c, f in module_result.findings.items() if not f.holds)
                text = f"{module_result.verdict}: {open_} of {name}"
                return Verdict(False, text, time.perf_counter() - began)
            told += [*assumption_texts(module_result.assumptions), *module_result.notes]
            names.append(f"{name} {module_result.verdict}")
    except SoterError as refused:
        return refusal(refused.diagnostics, began)
    text = names[0] if len(names) == 1 else f"all of {len(names)} proved"
    return Verdict(True, text, time.perf_counter() - began, tuple(told))


def refusal(diagnostics: Iterable[Diagnostic], began: float) -> Verdict:
    """Of a program that is none, or that poses no problem."""
    codes = ", ".join(dict.fromkeys(d.code for d in diagnostics if d.code))
    return Verdict(False, f"refused {codes}", time.perf_counter() - began)


def views_of(chosen: list[tuple[System, Module]]) -> list[tuple[System, Module]]:
    """Every module once for each of its views."""
    return [seen for flat, m in chosen for seen in systems_by_view(flat, m)]


# ---------------------------------------------------------------- flights


def first_violation(run: Run, shows: str) -> tuple[str, float] | None:
    """The first onset of a property with that in its text."""
    onsets = [
        (v.time_s, v.what)
        for v in run.violation_list
        if v.kind == "property" and shows in v.what and v.time_s is not None
    ]
    return None if not onsets else (min(onsets)[1], min(onsets)[0])


def flown(tree: Tree, world: World) -> tuple[int, str, float] | None:
    """(seed, property, time) of the earliest violation, or of one that is SOON; None: none."""
    program, params = tree.program(world.file), dict(world.params)
    violations = []
    for seed in range(1, world.seeds + 1):
        run = program.simulate(
            world.system, until=world.until_s, seed=seed, params=params, trace=False
        )
        first = first_violation(run, world.shows)
        if first is not None:
            violations.append((first[1], seed, first[0]))
            if first[1] <= SOON_S * _faster(world):
                break
    if not violations:
        return None
    at_s, seed, what = min(violations)
    return seed, what, at_s


def flown_again(tree: Tree, world: World, seed: int, what: str, at_s: float) -> bool:
    """Whether the interpreter, given the seed, violates the same at the same time."""
    if at_s > AGAIN_S * _faster(world):
        return False
    until_s = math.ceil((at_s + AFTER_S) * 1000.0) / 1000.0
    program, params = tree.program(world.file), dict(world.params)
    runs = [
        program.simulate(world.system, until=until_s, seed=seed, engine=e, params=params)
        for e in ("native", "interp")
    ]
    firsts = [first_violation(run, world.shows) for run in runs]
    return firsts == [(what, at_s)] * 2 and runs[0].trace_sha256 == runs[1].trace_sha256


def _faster(world: World) -> float:
    """A world without the vehicle takes a hundredth of the time."""
    return 100.0 if "battery" in world.file else 1.0


def refuted(folder: Path, edits: tuple[Edit, ...], worlds: Iterable[World]) -> Refutation | None:
    """The first world's flight that shows it, repeated; or one that was not, or None."""
    trees: dict[tuple[Edit, ...], Tree] = {}
    best = None
    for world in worlds:
        if world.narrowed not in trees:
            there = folder / str(len(trees))
            trees[world.narrowed] = laid_out(there, (*edits, *world.narrowed))
        tree = trees[world.narrowed]
        try:
            violation = flown(tree, world)
        except SoterError:
            continue  # refused here, too: nothing flies
        if violation is None:
            continue
        seed, what, at_s = violation
        again = flown_again(tree, world, seed, what, at_s)
        best = Refutation(world, seed, what, at_s, again)
        if again:
            return best
    return best


RAMS = "examples/drone/corridor_adversaries.soter"
HOSTILE = "examples/drone/surveillance_adversaries.soter"
OWN = "bench/drone/drone_wrong_{}.soter"
LEFT = "Contains"
"""The box that is flown."""
EMPTY, RESERVE = "charge > 0.0", "DRAIN"
WORST = (
    Edit("battery.soter", "power: float in [LEAST, MOST]", "power: float in [MOST, MOST]"),
    Edit("battery.soter", "{ charge: charge, docked", "{ charge: charge + ERROR, docked"),
    Edit("battery.soter", "measured battery.charge within ERROR;", ""),
)
"""All the time the most power there may be, and a charge that is shown as high as it may be."""
LOW = (("battery.START_CHARGE", 0.05),)
"""The unbroken stack stays in its dock with so little."""


def _worlds(file: str, systems: str, *more: object, **others: object) -> tuple[World, ...]:
    return tuple(World(file, system, *more, **others) for system in systems.split())  # type: ignore[arg-type]


WORLDS = {
    "late": _worlds(OWN.format("battery"), "Late Wavering", 3600.0, RESERVE, 4, narrowed=WORST),
    "late empty": _worlds(OWN.format("battery"), "Late Wavering", 3600.0, EMPTY, 4, narrowed=WORST),
    "lying": _worlds(OWN.format("planner"), "Lying", 40.0, "Sound", 4),
    "rammed": _worlds(RAMS, "Ramming Pushing Jerking", 60.0, LEFT, 4),
    "collision": _worlds(RAMS, "Ramming", 60.0, "NoCollision", 4),
    "jumps": _worlds(OWN.format("corridor"), "Jumping", 60.0, LEFT, 4),
    "landing": _worlds(OWN.format("corridor"), "Landing Jumping", 60.0, LEFT, 4),
    "stack": _worlds(HOSTILE, "Ramming Twitching", 60.0, LEFT, 3),
    "stack lying": _worlds(HOSTILE, "Lying", 60.0, "Sound", 3),
    "airborne": _worlds(HOSTILE, "Careless", 60.0, EMPTY, 2, LOW),
}
GROUPS: Groups = {}


def _edits(row: Row) -> Iterator[Edit]:
    for line in row.said[""]:
        file, edit = re.findall(r"(?:(\w+\.soter): )?(.*)", line)[0]
        yield from (Edit(file or row.one("in"), *made) for made in edits_of(edit, GROUPS))


def _wrong(row: Row) -> Wrong:
    name, _, words = row.name.partition(": ")
    file, _, module = row.one("verify").partition(" ")
    why = row.one("no")
    worlds = () if why else WORLDS[row.one("flown")]
    verify = (file, module or None)
    return Wrong(row.section, name, words, tuple(_edits(row)), verify, worlds, why, row.one("?"))


_TEXT = Path(__file__).with_name("wrong_stacks.txt")
_ALL = [_wrong(row) for row in rows(_TEXT, ("in", "verify", "flown", "no", "?"), GROUPS)]
WRONG = tuple(wrong for wrong in _ALL if not wrong.assumed)
ASSUMED = tuple(wrong for wrong in _ALL if wrong.assumed)
assert len({(wrong.kind, wrong.name) for wrong in _ALL}) == len(_ALL), "two of the same name"
