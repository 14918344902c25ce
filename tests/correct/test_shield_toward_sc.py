"""Shields `toward sc` (docs/evidence.md, A shield): what is not permitted is moved, then judged.

Purpose: both engines move alike, over random programs too; what comes out is what a reader of the
tests' own finds nearest, and is permitted; AC keeps control where it pushes; where nothing on the
way is permitted it is refused as before; a step that does not judge what it moved is noticed.
Non-goals: what a shield permits (`test_shield.py`, `test_shield_attacks.py`).
"""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import processes
import soter
from correct.test_shield import COMMANDS, SMALL, STEPS, everywhere, tables_of, written
from correct.test_shield_attacks import LAST_MOMENT, LOOP, VEHICLE
from generators.c_packages import make
from long_tests import examples, seeds
from soter.core import steps
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.front_end import check_file, system_of
from soter.language.model.typed import Literal
from soter.language.model.types import FLOAT
from soter.native.compiler import MEANING, find_compiler
from soter.native.shared_library import CHECK_FAILED
from soter.verify.deploy import shield_tables
from soter.verify.grid import estimate_sets
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Iterator


TOWARD = ("shield 8;", "shield 8 toward sc;")
PUSHES = COMMANDS["pushes at the wall"]
SMALL_TOWARD = SMALL.replace("shield 4;", "shield 4 toward sc;")
RARELY = "if sin(13.0 * time) > 0.95 { publish accel = A; }"
PROGRAMS = examples(4)


@pytest.mark.parametrize("step", COMMANDS.values(), ids=COMMANDS.keys())
def test_both_engines_move_alike_and_nothing_is_hit(step: str, tmp_path: Path) -> None:
    program = soter.load(written(tmp_path, step, TOWARD))
    runs = [
        program.simulate(system="Track", seed=1, until="12s", engine=e)
        for e in ("interp", "native")
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations
    assert np.abs(runs[1].truth("c")["x"]).max() < 10.0


def test_an_ac_that_pushes_keeps_control_and_comes_to_the_wall(tmp_path: Path) -> None:
    plain = soter.load(written(tmp_path, PUSHES)).simulate(system="Track", seed=1, until="20s")
    run = soter.load(written(tmp_path, PUSHES, TOWARD)).simulate(
        system="Track", seed=1, until="20s"
    )
    assert plain.modules["Shielded"].switches_to_sc > 5
    assert run.modules["Shielded"].switches_to_sc == 0
    assert not run.modules["Shielded"].gate_faults
    assert 8.0 < run.truth("c")["x"].max() < 10.0
    moved = run.moved("Shielded")
    published, count = run.moved_commands[0]
    assert 0 < moved.sum() == count < published
    assert any("its shield moved" in note for note in run.notes)
    assert (run.array("accel")[moved] < 3.0).all()
    assert not plain.moved("Shielded").any()


def test_where_nothing_on_the_way_is_permitted_a_command_is_refused(tmp_path: Path) -> None:
    """What was held for too long is in every V: no command makes that good."""
    run = soter.load(written(tmp_path, RARELY, TOWARD)).simulate(
        system="Track", seed=1, until="12s"
    )
    assert run.modules["Shielded"].gate_faults
    driver = next(c.index for c in run.system.components if c.name == "Shielded.Driver")
    assert run.final["components"][driver]["last_fault"] == FaultKind.SHIELD


# ---------------------------------------------------------------- a reader of its own


class Reader:
    """What of a run may act at instants, and where to commands are moved, read from the tables."""

    def __init__(self, path: Path, tables: Any, run: soter.Run) -> None:
        self.tables = tables
        flat = system_of(check_file(str(path)), "Track")
        self.window_ns = extract(flat, flat.modules[0]).times.replaced_window + 1_000
        self.at_ns = run.require_trace()["header"]["ct"].astype(np.int64)
        self.accel, self.proposed = run.array("accel"), run.array("Shielded.proposed")
        self.x, self.v = run.array("motion.x"), run.array("motion.v")
        self.edges = [-3.0 + 6.0 * (k / 8) for k in range(9)]

    def cell(self, u: float) -> int:
        return min(int(np.searchsorted(self.edges, u, side="right")) - 1, 7)

    def where(self, k: int) -> tuple[int, ...]:
        both = zip(self.tables.edges, (self.x[k], self.v[k]), strict=True)
        return tuple(int(np.searchsorted(np.array(e), y)) - 1 for e, y in both)

    def held(self, k: int) -> list[int]:
        """Cells of commands that were held until W before instant k, or later."""
        next_one = int(np.searchsorted(self.at_ns, self.at_ns[k] - self.window_ns, "left"))
        return [self.cell(u) for u in self.accel[max(0, next_one - 1) : k]]

    def permitted(self, k: int, cell: int) -> bool:
        cells = [cell, *self.held(k)]
        return bool(self.tables.commands.tops[self.where(k)][min(cells)] > max(cells))

    def fine(self, k: int, cell: int) -> bool:
        return bool(self.tables.commands.lasting[self.where(k)][cell]) and self.permitted(k, cell)

    def nearest(self, k: int) -> float:
        """By trying every cell, the nearest first."""
        mine, other = (float(u) for u in self.proposed[k])
        ends = sorted((self.cell(mine), self.cell(other)))
        best = [
            (abs(u - mine), u)
            for cell in range(ends[0], ends[1] + 1)
            if self.fine(k, cell)
            for u in [self.entrance(cell, mine)]
        ]
        if best:
            return min(best)[1]
        return other if self.permitted(k, self.cell(other)) else mine

    def entrance(self, cell: int, mine: float) -> float:
        """The number of a cell that is nearest to one."""
        last = self.edges[8] if cell == 7 else np.nextafter(self.edges[cell + 1], -np.inf)
        return float(min(max(mine, self.edges[cell]), last))


@pytest.mark.parametrize("step", [PUSHES, COMMANDS["to and fro"], LAST_MOMENT, RARELY])
def test_what_is_published_is_the_nearest_and_permitted(step: str, tmp_path: Path) -> None:
    path = written(tmp_path, step, TOWARD)
    program = soter.load(path)
    tables = tables_of(program)
    run = program.simulate(system="Track", seed=5, until="8s")
    trace, reader = run.require_trace(), Reader(path, tables, run)
    told = trace["stamps"][:, run.system.modules[0].outputs[0]] == reader.at_ns
    checked = 0
    for k in map(int, np.flatnonzero(told & (run.mode("Shielded") == 1))):
        if reader.at_ns[k] > reader.window_ns:
            assert reader.permitted(k, reader.cell(reader.accel[k])), reader.at_ns[k]
            assert reader.accel[k] == reader.nearest(k), reader.at_ns[k]
            checked += 1
    assert checked > 20
    assert run.moved("Shielded").any() == any(
        reader.accel[k] != reader.proposed[k][0]
        for k in np.flatnonzero(told & (run.mode("Shielded") == 1))
    )


# ---------------------------------------------------------------- random programs


def drawn(chance: random.Random) -> str:
    """Two axes, each with a command of its own in a set of its own, published now and then."""

    def number(low: float, high: float) -> float:
        return round(chance.uniform(low, high), 3)

    def step(topic: str, low: float, high: float) -> str:
        ways = (
            f"publish {topic} = {high};",
            f"publish {topic} = {min(high, -low)} * sin({number(1, 90)} * time);",
            f"publish {topic} = sin({number(20, 90)} * time) > 0.0 ? {high} : {low};",
            f"if sin({number(5, 60)} * time) > {number(-0.9, 0.8)} {{ publish {topic} = {low}; }}",
        )
        return chance.choice(ways)

    sets = [(-number(0.4, 1.5), number(0.4, 1.5)) for _ in range(2)]
    record = chance.random() < 0.5
    fields = ", ".join(f"at{k}: x{k}" for k in range(2))
    topics = "".join(
        f"topic go{k}: float in [{a}, {b}] = {number(a, b)};\n" for k, (a, b) in enumerate(sets)
    )
    states = "".join(f"  state x{k}: float;\n" for k in range(2))
    drives = f"  drives here = {{ {fields} }};\n"
    types = "type Here = { at0: float, at1: float };\ntopic here: Here max_age 20ms;\n"
    axis = [f"here.at{k}" for k in range(2)]
    if not record:
        types = "".join(f"topic at{k}: float max_age 20ms;\n" for k in range(2))
        drives = "".join(f"  drives at{k} = x{k};\n" for k in range(2))
        axis = ["at0", "at1"]
    heard = "here" if record else "at0, at1"
    back = " ".join(
        f"publish go{k} = clamp(-{number(1, 3)} * {axis[k]}, {a}, {b});"
        for k, (a, b) in enumerate(sets)
    )
    pushes = " ".join(step(f"go{k}", a, b) for k, (a, b) in enumerate(sets))
    both = " && ".join(f"abs({a}) < 2.0" for a in axis)
    grids = " ".join(f"grid {a} in [-2.0, 2.0] / {chance.randint(30, 90)};" for a in axis)
    errors = ", ".join(f"{a} within {number(0.0, 0.02)}" for a in axis)
    return f"""soter 1;
{types}{topics}node Any period {chance.choice((5, 10, 20))}ms {{
  publishes go0, go1;
  step {{ {pushes} }}
}}
node Back period 10ms {{ subscribes {heard}; publishes go0, go1; step {{ {back} }} }}
plant Cart period 5ms {{
  reads go0, go1;
{drives}{states}  disturbance slip: float in [-0.05, 0.05];
  der x0 = go0 + slip;
  der x1 = go1;
  measured {errors};
}}
rta Keep {{
  ac Any;
  sc Back;
  period {chance.choice((20, 50))}ms;
  safe {both};
  shield {chance.choice((1, 2, 3, 7, 16, 33))} toward sc;
  verify {{ {grids} acts within {chance.randint(0, 9)}ms; }}
}}
system S {{
  c: Cart;
  module Keep;
  until 6s;
  always abs(c.truth.x0) < 2.0 && abs(c.truth.x1) < 2.0;
}}
"""


@pytest.mark.random
def test_random_programs_move_alike_in_both_engines(tmp_path: Path) -> None:
    moved = refused = 0
    for seed in seeds(PROGRAMS):
        path = tmp_path / "drawn.soter"
        path.write_text(drawn(random.Random(seed)), "utf-8")  # noqa: S311 - inputs of a test
        program = soter.load(path)
        runs = [program.simulate(seed=seed, engine=e) for e in ("interp", "native")]
        assert runs[0].trace_sha256 == runs[1].trace_sha256, seed
        assert not runs[1].violations, seed
        moved += int(runs[1].moved("Keep").any())
        refused += runs[1].modules["Keep"].gate_faults
    assert moved >= 2


# ---------------------------------------------------------------- proofs


def test_the_proof_is_that_of_the_shield_alone(tmp_path: Path) -> None:
    """The certificate holds what is permitted, and nothing of where to commands are moved."""
    told: list[list[tuple[str, bytes]]] = []
    for text in (SMALL, SMALL_TOWARD):
        path, cert = tmp_path / "small.soter", tmp_path / f"cert{len(told)}"
        path.write_text(text, "utf-8")
        assert soter.load(path).verify(cert=cert)["Keep"].verdict == "proved"
        assert soter.recheck(cert).accepted
        told.append(sorted((p.name, p.read_bytes()) for p in cert.rglob("*commands*.bin")))
    assert told[0] == told[1]
    assert told[0]


@pytest.mark.whole
def test_a_table_that_permits_too_much_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_tables = estimate_sets.find_permitted_commands

    def damaged(case: Any, proof: Any, engine: Any, part: Any, anywhere: Any) -> None:
        find_tables(case, proof, engine, part, anywhere)
        everywhere(part.tops, part.tops.shape[-1])

    monkeypatch.setattr(estimate_sets, "find_permitted_commands", damaged)
    (tmp_path / "small.soter").write_text(SMALL_TOWARD, "utf-8")
    soter.load(tmp_path / "small.soter").verify(cert=tmp_path / "cert")
    assert not soter.recheck(tmp_path / "cert").accepted


@pytest.mark.whole
def test_of_a_map_the_command_of_the_instant_is_moved(tmp_path: Path) -> None:
    path = tmp_path / "steps.soter"
    text = STEPS.replace("sin(5.0 * time)", "1.0").replace("shield 4;", "shield 4 toward sc;")
    path.write_text(text, "utf-8")
    program = soter.load(path)
    assert program.verify(refute=False)["Keep"].verdict == "proved"
    runs = [program.simulate(seed=1, until="60s", engine=e) for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations
    assert runs[1].moved("Keep").any()


# ---------------------------------------------------------------- deployed, and wrong


def test_deployed_c_moves_as_the_simulator_does(tmp_path: Path) -> None:
    path = written(tmp_path, LAST_MOMENT, TOWARD)
    path.write_text(path.read_text("utf-8") + VEHICLE, "utf-8")
    program = soter.load(path)
    run = program.simulate(system="Track", seed=5, until="12s")
    at_ns = run.require_trace()["header"]["ct"].astype(np.int64)
    program.build("c", tmp_path / "c", "Vehicle")
    done = make(tmp_path / "c", "lib")
    assert done.returncode == 0, done.stderr
    (tmp_path / "loop.c").write_text(LOOP)
    own, parts = tmp_path / "loop", [str(tmp_path / "loop.c"), str(tmp_path / "c" / "libshield.a")]
    parts.insert(1, str(CHECK_FAILED))
    words = [
        *find_compiler().command,
        "-std=c99",
        *MEANING,
        f"-I{tmp_path / 'c'}",
        *parts,
        "-lm",
        "-o",
    ]
    done = processes.run([*words, str(own)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    readings = zip(at_ns, run.array("motion.x"), run.array("motion.v"), strict=True)
    lines = [f"{t} {float(x).hex()} {float(v).hex()}" for t, x, v in readings]
    (tmp_path / "readings").write_text("\n".join(lines))
    with (tmp_path / "readings").open() as readings_of_run:
        told = processes.run([str(own)], stdin=readings_of_run, capture_output=True, text=True)
    assert told.returncode == 0
    assert [float.fromhex(x) for x in told.stdout.split()] == run.array("accel").tolist()
    assert run.moved("Shielded").any()


def differ(path: Path) -> bool:
    """Whether the engines do."""
    program = soter.load(path)
    runs = [
        program.simulate(system="Track", seed=1, until="6s", engine=e) for e in ("interp", "native")
    ]
    return runs[0].trace_sha256 != runs[1].trace_sha256


def full(w: Any, *_: Any) -> Iterator[Any]:
    """Every command is moved to the greatest."""
    yield Literal(FLOAT, w.span, 3.0)


def unjudged(*_: Any) -> None:
    """C that publishes what it moved without judging it."""


def held_judged(builder: Any, component: Any, outputs: Any) -> None:
    """C that judges what is held in the place of what it moved."""
    del outputs
    _judges(builder, component, ())


_judges = steps._emit_permission_guard


@pytest.mark.parametrize("wrong", [unjudged, held_judged])
def test_c_that_does_not_judge_what_it_moved_is_noticed(
    wrong: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands are moved to full throttle here, as if somebody had looked for the worst."""
    monkeypatch.setattr(shield_tables, "moved_commands", full)
    path = written(tmp_path, "publish accel = 0.5;", TOWARD)
    assert not differ(path)
    monkeypatch.setattr(steps, "_emit_permission_guard", wrong)
    assert differ(path)


def test_where_to_a_command_is_moved_is_no_part_of_the_proof(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Moved to anything at all it is judged: refused, perhaps, and nothing is hit."""

    monkeypatch.setattr(shield_tables, "moved_commands", full)
    run = soter.load(written(tmp_path, "publish accel = 0.5;", TOWARD)).simulate(
        system="Track", seed=1, until="20s"
    )
    assert not run.violations
    assert run.modules["Shielded"].gate_faults
    assert run.moved("Shielded").any()


@pytest.mark.parametrize("clause", ["shield 4 toward ac;", "shield 4 toward;", "shield toward sc;"])
def test_a_clause_that_names_nothing_to_move_toward_is_told(clause: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.soter"
    path.write_text(SMALL.replace("shield 4;", clause), "utf-8")
    checked = check_file(str(path))
    assert not checked.ok
    assert {d.code for d in checked.diagnostics.items} & {"S004", "S005", "S006", "M027"}


def test_the_sled_of_the_page_does_what_the_page_says(tmp_path: Path) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "evidence.md").read_text("utf-8")
    text = next(x for x in re.findall(r"```soter\n(.*?)```", page, re.DOTALL) if "Sled" in x)
    switches = []
    for clause in ("shield 8 toward sc;", "shield 8;"):
        path = tmp_path / "sled.soter"
        path.write_text(text.replace("shield 8 toward sc;", clause), "utf-8")
        run = soter.load(path).simulate(seed=1)
        switches.append(run.modules["Keep"].switches_to_sc)
        if clause.endswith("sc;"):
            published, moved = run.moved_commands[0]
            assert 0.85 < moved / published < 0.95
            assert run.modules["Keep"].ac_share == 1.0
    assert switches == [0, 53]
    assert f"SC takes it {switches[1]} times in these 20 s" in page
