"""What is built is what was checked: each number that C takes from a proof is the certificate's.

Purpose: `numbers_in` finds by structure every number of what a DM is built of: the problem of its
proof, and its tables or the claims of its `rest`. Each one is changed; where the C is another one
then, `soter build --cert` has to see it. A number that is added to a proof later is found as well.
So is each number of a certificate that has a place in the C.
"""

from __future__ import annotations

import json
from copy import copy, deepcopy
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_deployed_kinds import BELT, LINE  # type: ignore[import-not-found]
from test_deployed_sets import GRID, SHIELDED, SHIELDED_ROBOT  # type: ignore[import-not-found]

import soter
from soter.certificate.reading.folder import read_certificate
from soter.codegen.unit import generate
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import Literal
from soter.verify.deploy import missing_predicates
from soter.verify.deploy.proof_transfer import difference_from_certificate
from soter.verify.problem.problem import Leaf, Problem
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import RestClaims, rest_entry
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_levels import TubeLevels
from unit.certificate import small_proofs
from unit.certificate.tubes.test_forged_rest import PLAIN

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.language.model.system import System

BOAT = """soter 1;
topic fix: { x: float, v: float } in { x in [-90.0, 90.0], v in [-9.0, 9.0] } max_age 20ms;
topic u: float in [-2.0, 2.0] = 0.0;
topic seen: { low: float, high: float } = { low: -30.0, high: 30.0 } max_age 250ms static;
plant Boat period 10ms {
  reads u;
  drives fix = { x: x, v: v };
  state x: float;
  state v: float;
  disturbance wind: float in [-0.05, 0.07];
  der x = v;
  der v = u + wind;
  measured fix.x within 0.02, fix.v within 0.03;
}
node Look period 100ms { publishes seen; step { publish seen = { low: -30.0, high: 30.0 }; } }
node Push period 20ms { publishes u; step { publish u = 1.0; } }
node Anchor period 50ms {
  subscribes fix;
  publishes u;
  step { publish u = clamp(-1.0 * fix.x - 2.0 * fix.v, -2.0, 2.0); }
}
rta Keep {
  ac Push;
  sc Anchor;
  period 100ms;
  safe fix.x > seen.low && fix.x < seen.high;
  rest abs(fix.x) < 6.0 && abs(fix.v) < 4.0 within 10s;
  shield;
  verify { late dm 1ms; acts within 2ms; }
}
system Protected { b: Boat; node Look; module Keep; }
"""
HARBOUR = """soter 1;
import "proved.soter" as p;
system Robot deploys p.Protected {
  external topic p.fix every 10ms measured p.fix.x within 0.02, p.fix.v within 0.03;
  external topic p.u;
  node p.Look;
  module p.Keep;
}
"""
TRAIN = """soter 1;
import "proved.soter" as p;
system Robot deploys p.Line {
  external topic p.sight every 10ms
      measured p.sight.gap within 0.2, p.sight.way within 0.5, p.sight.v within 0.05;
  external topic p.levers;
  module p.Follow;
}
"""
CROSSING = """soter 1;
topic car: { v: float, x: float } in { v in [-20.0, 20.0] } max_age 20ms;
topic man: float max_age 20ms;
topic u: float in [-2.0, 2.0];
plant P period 10ms {
  reads u;
  drives car = { v: v, x: x };
  drives man = m;
  state v: float = 0.0;
  state x: float in [-1.0, 1.0];
  state m: float in [50.0, 60.0];
  disturbance walk: float in [-0.5, 0.5];
  der v = u;
  der x = v;
  der m = walk;
  measured car.v within 0.01, man within 0.03;
}
node Rush period 20ms { publishes u; step { publish u = 2.0; } }
node Stop period 20ms {
  subscribes car;
  publishes u;
  step { publish u = clamp(-2.0 * car.v, -2.0, 2.0); }
}
rta Keep {
  ac Rush;
  sc Stop;
  period 40ms;
  safe abs(car.v) < 0.2 || man - car.x > 2.0;
  rest abs(car.v) < 0.1 within 10s;
}
system Protected { p: P; module Keep; }
"""
STREET = """soter 1;
import "proved.soter" as p;
system Robot deploys p.Protected {
  external topic p.car every 10ms measured p.car.v within 0.01;
  external topic p.man every 10ms measured p.man within 0.03;
  external topic p.u;
  module p.Keep;
}
"""
MOVED = SHIELDED.replace("shield 4", "shield 4 toward sc")
KINDS = {
    "grid": GRID,
    "map": (BELT, LINE),
    "shield": (SHIELDED, SHIELDED_ROBOT),
    "moved": (MOVED, SHIELDED_ROBOT),
    "rest": (PLAIN, TRAIN),
    "judged": (BOAT, HARBOUR),
    "free": (CROSSING, STREET),
}
TAKEN = {
    "grid": {"built.edges", "built.entries"},
    "map": {"built.edges", "built.entries"},
    "shield": {"built.edges", "built.entries", "built.commands", "problem.controls"},
    "moved": {"built.edges", "built.entries", "built.commands", "problem.controls"},
    "rest": {"claims.ways", "claims.precision"}
    | {f"problem.{name}" for name in ("within_ns", "drifts", "errors")},
    "judged": {"claims.ways", "claims.precision", "problem.within_ns", "problem.times.schedule.sc"},
    "free": {"claims.ways[0]", "claims.ways[1]", "claims.ways[2]", "problem.errors"},
}
"""What at least is found to be in the C: a walk that finds nothing shows nothing."""
OF_NO_CLAIM = ("claims.precision", "built.commands.lasting")
"""How forms are shortened, each way of which is sound, and which command is proposed: what is
proposed is judged like any other. No claim rests on them, and no certificate has them."""
MANY = 100
"""Whole numbers up to this one are changed by 1, others to twice as much."""
PLACES = {"topic_leaf_of_state", "state_of_leaf", "map_leaves", "state", "states", "control"}
"""Numbers that count: which state, which topic. A certificate has names for them."""
PROGRAM = ("soter.language.", "soter.core.")
"""The rooms of the classes of a program, its system and its code: no proof found these."""


@dataclass
class Made:
    """What a DM is built of: a problem, and either tables or the claims of `rest`."""

    problem: Problem
    built: list[Any]
    claims: RestClaims | None = None

    @property
    def tables(self) -> list[Any]:
        """What `complete` would install."""
        if self.claims is None:
            return self.built
        assert isinstance(self.problem, TubeProblem)
        check = TubeCheck(self.problem)
        check.precision = self.claims.precision
        return [TubeLevels.of_check(check, self.claims.ways, rest_entry(check, self.claims))]


def numbers_in(part: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Every number of a part: where it is, and the part with another number there."""
    if isinstance(part, (bool, str, bytes, Leaf)) or type(part).__module__.startswith(PROGRAM):
        return
    if isinstance(part, int):
        yield at, part + (part if part > MANY else 0) + 1
    elif isinstance(part, float):
        yield at, _other(part)
    elif isinstance(part, np.ndarray):
        yield from _entries_in(part, at)
    elif is_dataclass(part) and not isinstance(part, type):
        for f in (f for f in fields(part) if f.init and f.name not in PLACES):
            for where, new in numbers_in(getattr(part, f.name), f"{at}.{f.name}"):
                yield where, replace(part, **{f.name: new})
    elif isinstance(part, dict):
        for key, value in part.items():
            for where, new in numbers_in(value, f"{at}[{key}]"):
                yield where, {**part, key: new}
    elif isinstance(part, (tuple, list)) and part:
        for k in sorted({0, len(part) - 1}):
            for where, new in numbers_in(part[k], f"{at}[{k}]"):
                yield where, type(part)((*part[:k], new, *part[k + 1 :]))


def _other(number: float) -> float:
    return number * 1.25 + 0.0771


def _entries_in(array: Any, at: str) -> Iterator[tuple[str, Any]]:
    """The first and the last number of an array."""
    if array.dtype != np.bool_ and array.size:
        for k in sorted({0, array.size - 1}):
            changed = array.copy()
            value = changed.reshape(-1)[k]
            changed.reshape(-1)[k] = value + 1 if array.dtype.kind in "iu" else _other(value)
            yield f"{at}[{k}]", changed


class Robot:
    """A proved program, its certificate, and what the DM of its robot is built of."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.kind = kind
        for name, text in zip(("proved.soter", "robot.soter"), KINDS[kind], strict=True):
            (folder / name).write_text(text)
        soter.load(folder / "proved.soter").verify(cert=folder / "cert", refute=False)
        self.folder, self.program = folder, soter.load(folder / "robot.soter")
        self.certificate = read_certificate(folder / "cert")
        (entry,) = self.certificate.manifest["modules"]
        self.names = entry["system"], entry["module"]
        self.made = self._made()
        self.text = "" if self.made.claims is None else self.made.tables[0].text

    def _made(self) -> Made:
        heard: list[Any] = []

        class Listening:
            def sets(self, problem: Problem) -> None:
                del problem

            def check_build(self, problem: Problem, tables: Any) -> None:
                heard.extend((problem, tables))

        there = self.program.declared().proved
        assert there is not None
        missing_predicates.complete(there, Listening())
        problem, tables = heard
        if not isinstance(problem, TubeProblem):
            return Made(problem, tables)
        return Made(problem, [], missing_predicates.rest_claims(TubeCheck(problem)))

    def given(self, made: Made, tables: list[Any]) -> System:
        """The robot's system with a DM of these tables."""
        here = self.program.declared()
        there = here.proved
        assert there is not None
        missing_predicates.install_predicates(there, there.modules[0], made.problem, tables)
        missing_predicates._copy_predicates(here, there)
        return here

    def predicates(self, made: Made) -> str:
        """All that the C of the DM is made of, as text: it takes a tenth of the time of the C.

        Of another check that follows SC just that: then the C is another one in any case.
        """
        tables = made.tables
        if made.claims is not None and tables[0].text != self.text:
            return str(tables[0].text)
        (module,) = self.given(made, tables).modules
        shield = module.shield
        parts = module.symbol.ttf, module.symbol.safer, *(shield.expressions if shield else ())
        if made.claims is None:
            return repr(parts)
        own = [n for n in nodes(parts) if isinstance(n, Literal)]  # the text has those of functions
        return repr((tables[0].text, own))

    def written(self, made: Made) -> str:
        """The C of the robot with a DM of these tables."""
        here = self.given(made, made.tables)
        return generate(here, lower(here)).source

    def differs(self, made: Made) -> str:
        """What `build --cert` finds to be another than in the certificate."""
        return difference_from_certificate(self.certificate, *self.names, made.problem, made.tables)


ROBOTS: dict[str, Robot] = {}


@pytest.fixture
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    kind: str = request.param
    if kind not in ROBOTS:
        ROBOTS[kind] = Robot(tmp_path_factory.mktemp(kind), kind)
    return ROBOTS[kind]


def changes(made: Made) -> Iterator[tuple[str, Made]]:
    """Every number of what a DM is built of, and that with another one in its place."""
    for name in ("problem", "built", "claims"):
        for where, part in numbers_in(getattr(made, name), name):
            yield where.replace("built[0]", "built"), replace(made, **{name: part})


@pytest.mark.parametrize("robot", KINDS, indirect=True)
def test_each_number_that_c_takes_from_a_proof_is_compared(robot: Robot) -> None:
    right = robot.predicates(robot.made)
    assert robot.differs(robot.made) == ""
    found: dict[str, Made] = {}
    for where, made in changes(robot.made):
        try:
            if robot.predicates(made) != right:
                found[where] = made
        except (SoterError, AssertionError, ArithmeticError, ValueError, IndexError):
            continue  # nothing can be built of it
    for least in TAKEN[robot.kind]:
        assert any(where.startswith(least) for where in found), (least, list(found))
    assert robot.written(found.popitem()[1]) != robot.written(robot.made)
    free = [w for w, made in found.items() if not robot.differs(made)]
    assert [w for w in free if not w.startswith(OF_NO_CLAIM)] == []


def figures_of(entry: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Every number of a module's entry, as whole or hexadecimal ones, and every file; and where."""
    if isinstance(entry, (dict, list)):
        every = entry.items() if isinstance(entry, dict) else enumerate(entry)
        for key, part in every:
            yield from figures_of(part, (*at, key))
    elif isinstance(entry, int) or (isinstance(entry, str) and entry.startswith(("sets/", *SIGNS))):
        yield at, entry


SIGNS = ("0x", "-0x")
BUILT = {"times", "inputs", "tables", "rest"}
"""The parts of an entry that are about what a DM is built of; sets are what shows them."""


def other(figure: Any, contents: dict[str, bytes]) -> Any:
    """Another figure in the place of this one."""
    if isinstance(figure, int):
        return figure + 1
    if figure in contents:
        return bytes([*contents[figure][:-1], contents[figure][-1] ^ 1])
    return _other(float.fromhex(figure)).hex()


@pytest.mark.parametrize("robot", KINDS, indirect=True)
def test_each_number_of_a_certificate_about_the_dm_is_compared(robot: Robot) -> None:
    """Times, ranges, tables, and all that is said of `rest`, one number after the other."""
    right, certificate = robot.certificate, copy(robot.certificate)
    changed = 0
    for at, figure in figures_of(right.manifest["modules"][0]):
        if at[0] not in BUILT:
            continue
        certificate.manifest, certificate.contents = deepcopy(right.manifest), {**right.contents}
        if figure in right.contents:
            certificate.contents[figure] = other(figure, right.contents)
        else:
            part = certificate.manifest["modules"][0]
            for key in at[:-1]:
                part = part[key]
            part[at[-1]] = other(figure, right.contents)
        made = robot.made
        assert difference_from_certificate(certificate, *robot.names, made.problem, made.tables), (
            at,
            figure,
        )
        changed += 1
    assert changed > 20


def test_where_sc_rests_is_built_as_it_was_checked(tmp_path: Path) -> None:
    """Y is 1.3 times as wide: true, accepted, and not what the prover has found."""
    train = Robot(tmp_path, "rest")
    made = train.program.build("c", tmp_path / "right", cert=tmp_path / "cert")
    assert "checked again" in made.inherits[0]
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    ways = manifest["modules"][0]["rest"]["ways"]
    for name, ends in ways.items():
        ways[name] = [(1.3 * float.fromhex(x)).hex() for x in ends]
    small_proofs.reseal(tmp_path / "cert", manifest)
    assert soter.recheck(tmp_path / "cert").accepted
    with pytest.raises(SoterError, match="is built with other `ways` than it has") as caught:
        train.program.build("c", tmp_path / "out", cert=tmp_path / "cert")
    assert caught.value.diagnostics[0].code == "D020"
    assert not (tmp_path / "out").exists()


def test_times_of_written_predicates_are_those_that_were_checked(tmp_path: Path) -> None:
    """A claim about more schedules than there are is true, and not about what is built."""
    text = GRID[0].replace("< TOP;", "< TOP;\n  ttf abs(motion) > 7.0;\n  safer abs(motion) < 4.0;")
    (tmp_path / "proved.soter").write_text(text)
    (tmp_path / "robot.soter").write_text(GRID[1])
    soter.load(tmp_path / "proved.soter").verify(cert=tmp_path / "cert", refute=False)
    robot = soter.load(tmp_path / "robot.soter")
    made = robot.build("c", tmp_path / "right", cert=tmp_path / "cert")
    assert "checked again" in made.inherits[0]
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    manifest["modules"][0]["times"]["j_ns"] += 1
    small_proofs.reseal(tmp_path / "cert", manifest)
    assert soter.recheck(tmp_path / "cert").accepted
    with pytest.raises(SoterError, match="is built with other times than it has"):
        robot.build("c", tmp_path / "out", cert=tmp_path / "cert")


def test_the_window_of_a_shield_is_checked_again(tmp_path: Path) -> None:
    """W says for how long a replaced command counts: the DM may not forget it sooner."""
    Robot(tmp_path, "shield")
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    times = manifest["modules"][0]["times"]
    for by, verdict in ((1, "accepted"), (-2, "rejected")):
        times["W_ns"] += by
        small_proofs.reseal(tmp_path / "cert", manifest)
        report = soter.recheck(tmp_path / "cert")
        assert report.verdict == verdict, report.reason
    assert "W_ns" in report.reason


OPEN = {
    "SC does not brake": (("brake: 1.0 }; }", "brake: 0.0 }; }"), "never gets control"),
    "it moves further": (("by CREEP down", "by 0.0001 down"), "not shown"),
}


@pytest.mark.parametrize("name", OPEN)
def test_an_open_proof_is_built_as_far_as_it_goes(name: str, tmp_path: Path) -> None:
    """What the certificate does not claim nobody compares, and what is built is said."""
    edit, note = OPEN[name]
    (tmp_path / "proved.soter").write_text(PLAIN.replace(*edit))
    (tmp_path / "robot.soter").write_text(TRAIN)
    report = soter.load(tmp_path / "proved.soter").verify(cert=tmp_path / "cert", refute=False)
    assert report.modules[0].findings["P2a"].verdict == "undecided"
    made = soter.load(tmp_path / "robot.soter").build("c", tmp_path / "out", cert=tmp_path / "cert")
    assert "safety is not established: P2a" in made.inherits[0]
    assert any(note in x for x in made.notes)


OLD_READS = """soter 1;
topic x: float in [-5.0, 5.0] max_age 200ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 10ms {
  reads u;
  drives x = p;
  state p: float in [0.3, 0.31];
  der p = 0.5 * p + u;
  measured x within 0.005;
}
node Fast period 50ms { publishes u; step { publish u = 1.0; } }
node Slow period 50ms {
  subscribes x;
  publishes u;
  step { publish u = x > 0.0 || x < -0.2 ? -1.0 : 1.0; }
}
rta M {
  ac Fast;
  sc Slow;
  period 50ms;
  safe abs(x) < 1.0;
  verify {
    levels 2; recover never; grid x in [-1.1, 1.1] / 110; horizon 254ms;
    late dm 1ms, sc 1ms; response dm 1ms, sc 1ms; acts within 1ms;
  }
}
system S { p: P; module M; }
"""
FAR_OFF = """soter 1;
import "proved.soter" as p;
system Robot deploys p.S {
  external topic p.x every 150ms delayed 40ms measured p.x within 0.005;
  external topic p.u;
  module p.M;
}
"""


def test_what_was_checked_for_younger_reads_is_not_built_for_older_ones(tmp_path: Path) -> None:
    """SC leads back on reads that are 4 ms old, as the plant makes them, and not at 190 ms."""
    manifests = []
    for age in ("20ms", "200ms"):
        (tmp_path / "proved.soter").write_text(OLD_READS.replace("200ms", age))
        report = soter.load(tmp_path / "proved.soter").verify(cert=tmp_path / age, refute=False)
        assert report.modules[0].findings["P2a"].holds == (age == "20ms")
        manifests.append(json.loads((tmp_path / age / "manifest.json").read_text()))
    (young,), (old,) = (m["modules"] for m in manifests)
    young["times"] = old["times"]
    (tmp_path / "20ms" / "program" / "proved.soter").write_text(OLD_READS)
    small_proofs.reseal(
        tmp_path / "20ms", {**manifests[1], "modules": [young], "files": manifests[0]["files"]}
    )
    assert soter.recheck(tmp_path / "20ms").accepted
    (tmp_path / "robot.soter").write_text(FAR_OFF)
    with pytest.raises(SoterError, match="no older than its plants make them"):
        soter.load(tmp_path / "robot.soter").build("c", tmp_path / "out", cert=tmp_path / "20ms")
