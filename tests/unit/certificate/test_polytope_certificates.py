"""Certificates with polytopes: right ones are accepted, whatever overstates is rejected."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from long_tests import some
from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.polytope import polytope_group
from soter.certificate.polytope.certificate_tables import HalfSpaces
from soter.certificate.polytope.polytope_check import PolytopeCheck
from soter.certificate.polytope.polytope_group import PolytopeGroup
from soter.certificate.rechecker import recheck
from soter.certificate.report import RejectedError
from soter.language.front_end import check_file
from soter.verify.polytope import extract_group as polytope_extract
from soter.verify.polytope import linear_group as polytope_model
from soter.verify.polytope import tables
from unit.certificate import small_proofs
from work import work_of

CALLS_MAX = 2_000_000
"""Functions called until a certificate that asks for too much is refused."""

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.certificate.report import Report
    from soter.verify.claims.results import VerifyReport

    Edit = Callable[["Opened"], None]

pytest.importorskip("highspy")

PROGRAM = """soter 1;
const A: float = 5.0;
const WALL: float = 1.5;
type Motion = { x: float, v: float };
topic motion: Motion max_age 10ms;
input topic goal: float in [-2.0, 2.0] = 1.9;
topic accel: float in [-A, A] = 0.0;
plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.02, motion.v within 0.05;
}
node Fast period 10ms {
  subscribes motion, goal;
  publishes accel;
  step { publish accel = clamp(9.0 * (goal - motion.x) - motion.v, -A, A); }
}
node Careful period 20ms {
  subscribes motion;
  publishes accel;
  step { publish accel = clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A); }
}
rta SafeCart {
  ac Fast;
  sc Careful;
  period 20ms;
  safe abs(motion.x) < WALL;
  PREDICATES
  verify {
    polytope motion.x in [-2.0, 2.0], motion.v in [-6.0, 6.0];
    late dm 500us, sc 1ms;
    response dm 500us, sc 1ms;
    acts within 1ms;
    MORE
  }
}
system Protected default { c: Cart; module SafeCart; }
"""
PREDICATES = """ttf abs(motion.x) > 0.7 || abs(motion.v) > 0.8;
  safer abs(motion.x) < 0.6 && abs(motion.v) < 0.7;"""
LAW = "clamp(-2.0 * motion.x - 2.5 * motion.v, -A, A)"
LIMITED = f"max(min({LAW}, motion.x + 90.0), motion.v - 90.0)"
BESIDE = (
    ("type Motion = { x: float, v: float };", "type Motion = { x: float, v: float, z: float };"),
    ("{ x: x, v: v }", "{ x: x, v: v, z: z }"),
    ("state v: float = 0.0;", "state v: float = 0.0;\n  state z: float = 0.0;"),
    ("der v = accel + wind;", "der v = accel + wind + 0.05 * z;\n  der z = wind - z;"),
    ("MORE", "grid motion.z in [-0.5, 0.5] / 40;"),
)
PARAMETER = (
    ("state v: float = 0.0;", "state v: float = 0.0;\n  state k: int in [1, 2] = 1;"),
    ("der v = accel", "der v = accel * (k == 1 ? 1.0 : 0.9)"),
)
TWO = (
    ("{ x: float, v: float };", "{ x: float, v: float, y: float, w: float };"),
    ("topic accel: float in [-A, A] = 0.0;",
     "topic accel: float in [-A, A] = 0.0;\ntopic side: float in [-A, A] = 0.0;"),
    ("reads accel;", "reads accel, side;"),
    ("{ x: x, v: v }", "{ x: x, v: v, y: y, w: w }"),
    ("state v: float = 0.0;",
     "state v: float = 0.0;\n  state y: float = 0.0;\n  state w: float = 0.0;"),
    ("der v = accel + wind;",
     "der v = accel + wind + 0.1 * y;\n  der y = w;\n  der w = side + 0.1 * x;"),
    ("motion.v in [-6.0, 6.0];",
     "motion.v in [-6.0, 6.0], motion.y in [-1.5, 1.5], motion.w in [-6.0, 6.0];"),
    (f"publish accel = {LAW};",
     f"publish accel = {LAW};\n  publish side = clamp(-2.0 * motion.y - 2.4 * motion.w, -A, A);"),
    ("  publishes accel;\n  step { publish accel = clamp(9.0",
     "  publishes accel, side;\n  step { publish side = 0.0; publish accel = clamp(9.0"),
    ("  publishes accel;\n  step { publish accel = clamp(-2.0",
     "  publishes accel, side;\n  step { publish accel = clamp(-2.0"),
)  # fmt: skip


def program(*changes: tuple[str, str]) -> str:
    text = PROGRAM
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text.replace("PREDICATES", "").replace("MORE", "")


def written(folder: Path, text: str) -> tuple[Path, VerifyReport]:
    path = folder / "cart.soter"
    path.write_text(text)
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    return folder / "cert", report


def checked(folder: Path) -> Report:
    return recheck(folder, workers=1)


# ---------------------------------------------------------------- what is right

RIGHT: dict[str, tuple[tuple[str, str], ...]] = {
    "predicates of the user": (("PREDICATES", PREDICATES),),
    "a grid beside": BESIDE,
    "a grid beside, predicates of the user": (*BESIDE, ("PREDICATES", PREDICATES)),
    "a parameter": PARAMETER,
    "two controls": TWO,
    "two levels": (("MORE", "levels 2;"),),
    "four levels": (("MORE", "levels 4;"),),
    "a tighter clamp": ((LAW, LAW.replace("-A, A", "-3.0, 4.0")),),
    "limits that vary": ((LAW, LIMITED),),
    "a law by cases": (
        (f"publish accel = {LAW};",
         f"if motion.x > 5.0 {{ publish accel = A; }} else {{ publish accel = {LAW}; }}"),
    ),
    "a time to return": (("MORE", "recover within 30s;"),),
}  # fmt: skip


@pytest.mark.parametrize("name", some(RIGHT, 3))
def test_what_the_prover_writes_is_accepted(name: str, tmp_path: Path) -> None:
    folder, verify_report = written(tmp_path, program(*RIGHT[name]))
    assert verify_report.verdict == "proved", verify_report
    report = checked(folder)
    assert report.accepted, report.reason
    assert report.safe
    assert report.returns


def numbers_of(source: str, name: str) -> list[float]:
    """The elements of a constant array in C."""
    match = re.search(rf"{name} = \{{\s*\.at = \{{([^}}]*)\}}", source)
    assert match, name
    return [float(x) for x in match.group(1).split(",") if x.strip()]


def test_build_deploys_the_half_spaces_of_the_certificate(right: Path, tmp_path: Path) -> None:
    soter.load(right / "program" / "cart.soter").build("c", tmp_path, "Protected")
    source = (tmp_path / "cart.c").read_text()
    (table,) = json.loads((right / "manifest.json").read_text())["modules"][0]["tables"]
    for part in ("outer", "inner"):
        given = table[part]["faces"]
        faces = np.fromfile(right / given["file"], dtype="<f8").reshape(given["shape"])
        rows = numbers_of(source, f"SafeCart_level_{part}_ROWS")
        assert rows == faces[:, :-1].ravel().tolist()
        assert numbers_of(source, f"SafeCart_level_{part}_LIMITS") == faces[:, -1].tolist()
        box = np.fromfile(right / table[part]["box"]["file"], dtype="<f8")
        assert all(x.hex() in source or repr(x) in source for x in box.tolist())


# ---------------------------------------------------------------- what is wrong


class Opened:
    """A certificate under change."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
        self.entry = self.manifest["modules"][0]
        self.group = self.entry["cases"][0]["groups"][0]

    def matrix(self, of: dict[str, Any], change: Callable[[Any], Any]) -> None:
        """Change the numbers of a matrix."""
        path = self.folder / of["file"]
        values = np.frombuffer(path.read_bytes(), dtype="<f8").reshape(of["shape"]).copy()
        values = np.asarray(change(values), dtype="<f8")
        of["shape"] = list(values.shape)
        path.write_bytes(values.tobytes())

    def program(self, old: str, new: str, **entry: Any) -> None:
        """Change the program, and the entry of its module."""
        self.entry.update(entry)
        path = self.folder / "program" / "cart.soter"
        text = path.read_text()
        assert text.count(old) == 1, old
        path.write_text(text.replace(old, new))

    def seal(self) -> Path:
        """Every hash as it should be."""
        path = self.folder / "program" / "cart.soter"
        made = check_file(str(path))
        if made.program is not None:
            self.manifest["program_sha256"] = made.program.sha256
        for name in self.manifest["files"]:
            data = (self.folder / name).read_bytes()
            self.manifest["files"][name] = hashlib.sha256(data).hexdigest()
        small_proofs.seal(self.folder, self.manifest)
        return self.folder


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, report = written(tmp_path_factory.mktemp("right"), program())
    assert report.verdict == "proved"
    return folder


@pytest.fixture(scope="module")
def users(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = program(("PREDICATES", PREDICATES), ("MORE", "recover within 30s;"))
    folder, report = written(tmp_path_factory.mktemp("users"), text)
    assert report.verdict == "proved"
    return folder


def rejected(folder: Path, tmp_path: Path, edit: Edit) -> str:
    at = Opened(shutil.copytree(folder, tmp_path / "cert"))
    edit(at)
    report = checked(at.seal())
    assert not report.accepted
    assert "Error" not in report.reason
    return report.reason


def out(factor: float) -> Callable[[Any], Any]:
    """Half-spaces moved out; boxes made larger."""

    def change(m: Any) -> Any:
        m[..., -1] += factor * np.abs(m[..., -1])
        return m

    return change


def scaled(factor: float) -> Callable[[Any], Any]:
    return lambda m: m * factor


def weights(factor: float) -> Callable[[Any], Any]:
    return lambda m: m * np.array([1.0, 1.0, factor])


EDITS: dict[str, Edit] = {
    "K is larger": lambda c: c.matrix(c.group["K"]["faces"], out(1e-3)),
    "R is larger": lambda c: c.matrix(c.group["R"]["faces"], out(1e-3)),
    "Q is larger": lambda c: c.matrix(c.group["Q"]["faces"], out(1e-3)),
    "S_0 is larger": lambda c: c.matrix(c.group["S"][0]["faces"], out(1e-3)),
    "S_1 is larger": lambda c: c.matrix(c.group["S"][1]["faces"], out(1e-3)),
    "G_1 is larger": lambda c: c.matrix(c.group["G"][0]["faces"], out(1e-3)),
    "the target is larger": lambda c: c.matrix(c.group["target"]["faces"], out(1e-3)),
    "K is a box": lambda c: c.matrix(c.group["K"]["faces"], lambda m: m[:0]),
    "R is K": lambda c: c.group.update(R=c.group["K"]),
    "Q is K": lambda c: c.group.update(Q=c.group["K"]),
    "S_0 is R": lambda c: c.group["S"].__setitem__(0, c.group["R"]),
    "S_1 is S_0": lambda c: c.group["S"].__setitem__(1, c.group["S"][0]),
    "one S less": lambda c: c.group.update(S=c.group["S"][:1], G=[]),
    "no S": lambda c: c.group.update(S=[], G=[]),
    "K's box is larger": lambda c: c.matrix(c.group["K"]["box"], scaled(1.01)),
    "R's box is larger": lambda c: c.matrix(c.group["R"]["box"], scaled(1.2)),
    "C is larger": lambda c: c.matrix(c.group["C"], scaled(1.1)),
    "C is outside": lambda c: c.matrix(c.group["C"], scaled(2.0)),
    "the rate is lower": lambda c: c.matrix(c.group["rates"]["K"], scaled(0.9)),
    "the rate of Q is lower": lambda c: c.matrix(c.group["rates"]["Q"], scaled(0.5)),
    "no rate": lambda c: c.matrix(c.group["rates"]["K"], lambda m: m[:0]),
    "fewer holds": lambda c: c.group.update(periods=c.group["periods"] // 2),
    "no hold": lambda c: c.group.update(periods=0),
    "holds without number": lambda c: c.group.update(periods=1.5),
    "wider limits of the law": lambda c: c.matrix(c.group["law"]["limits"], scaled(1.2)),
    "a stronger law": lambda c: c.matrix(c.group["law"]["gain"], scaled(1.01)),
    "another rest": lambda c: c.matrix(c.group["law"]["offset"], lambda m: m + 0.5),
    "an unknown control": lambda c: c.group["law"].update(controls=["nothing"]),
    "a control twice": lambda c: c.group["law"].update(controls=2 * c.group["law"]["controls"]),
    "a shorter hold": lambda c: c.group["instants"].update(hold=[0, 10**6, 2 * 10**6]),
    "fewer instants": lambda c: c.group["instants"].update(hold=[0, 20 * 10**6]),
    "a shorter horizon": lambda c: c.group["instants"].update(
        R=[t // 2 for t in c.group["instants"]["R"]]
    ),
    "a shorter window": lambda c: c.group["instants"].update(
        window=[t // 2 for t in c.group["instants"]["window"]]
    ),
    "a shorter start": lambda c: c.group["instants"].update(start=[0, 0]),
    "instants that go back": lambda c: c.group["instants"]["hold"].insert(1, 30 * 10**6),
    "no multipliers": lambda c: c.group.update(multipliers={}),
    "the DM lets more through": lambda c: c.matrix(
        c.entry["tables"][0]["outer"]["faces"], out(1e-3)
    ),
    "the DM gives more back": lambda c: c.matrix(c.entry["tables"][0]["inner"]["faces"], out(1e-3)),
    "the DM's thresholds are not lowered": lambda c: c.matrix(
        c.entry["tables"][0]["outer"]["faces"], out(1e-15)
    ),
    "the DM gives less back": lambda c: c.matrix(
        c.entry["tables"][0]["inner"]["faces"], out(-1e-3)
    ),
    "the DM's box is larger": lambda c: c.matrix(c.entry["tables"][0]["outer"]["box"], scaled(1.2)),
    "the DM knows fewer half-spaces": lambda c: c.matrix(
        c.entry["tables"][0]["outer"]["faces"], lambda m: m[1:]
    ),
    "the DM reads in another order": lambda c: c.entry["tables"][0]["states"].reverse(),
    "no DM": lambda c: c.entry.update(tables=[]),
    "axes in another order": lambda c: c.group["axes"].reverse(),
    "a number that is none": lambda c: c.matrix(
        c.group["K"]["faces"], lambda m: np.where(m == m[0, 0], np.nan, m)
    ),
    "an endless number": lambda c: c.matrix(
        c.group["K"]["faces"], lambda m: np.where(m == m[0, -1], np.inf, m)
    ),
    "faces of another group": lambda c: c.matrix(c.group["K"]["faces"], lambda m: m[:, 1:]),
    "a field too many": lambda c: c.group.update(trust="me"),
    "a field less": lambda c: c.group.pop("law"),
    "more wind": lambda c: c.program("in [-0.2, 0.2]", "in [-0.21, 0.21]"),
    "a weaker law": lambda c: c.program("clamp(-2.0 *", "clamp(-1.9 *"),
    "a law of another sign": lambda c: c.program("- 2.5 * motion.v", "+ 2.5 * motion.v"),
    "a law that steps": lambda c: c.program(LAW, f"motion.x > 0.5 ? A : {LAW}"),
    "an earlier clamp": lambda c: c.program(LAW, LAW.replace("-A, A", "-1.0, 1.0")),
    "a plant that is moved": lambda c: c.program("der x = v;", "der x = v + 0.01;"),
    "a plant with feedback": lambda c: c.program(
        "der v = accel + wind;", "der v = accel + wind + 0.1 * x;"
    ),
    "a plant that is not linear": lambda c: c.program(
        "der v = accel + wind;", "der v = accel + wind + 0.1 * x * x;"
    ),
    "a nearer wall": lambda c: c.program("WALL: float = 1.5", "WALL: float = 1.4"),
    "a start elsewhere": lambda c: c.program("state v: float = 0.0", "state v: float = 5.9"),
}


UNREAD: dict[str, tuple[Edit, str]] = {
    "instants of nothing": (
        lambda c: c.group["instants"].update(more=[0, 1]),
        "no claim rests on `instants.more`",
    ),
    "rates of R": (
        lambda c: c.group["rates"].update(R=c.group["rates"]["K"]),
        "no claim rests on `rates.R`",
    ),
    "no instants of a hold": (
        lambda c: c.group["instants"].pop("hold"),
        "the instants of `hold` do not end when they should",
    ),
    "no rate of K": (
        lambda c: c.group["rates"].pop("K"),
        "the rates of a polytope group are not one for each control",
    ),
    "instants of a start that is not claimed": (
        lambda c: c.entry["claims"].update(start="undecided"),
        "no claim rests on `instants.start`",
    ),
    "a way back that is not claimed": (
        lambda c: c.entry["claims"].update(P2b="undecided"),
        "no claim rests on `Q`",
    ),
    "a word beside a matrix": (lambda c: c.group["C"].update(by="me"), "a matrix is a file"),
    "a word in the law": (lambda c: c.group["law"].update(by="me"), "the law of a polytope"),
}


@pytest.mark.parametrize("name", UNREAD)
def test_what_nothing_reads_is_rejected(name: str, right: Path, tmp_path: Path) -> None:
    edit, why = UNREAD[name]
    assert rejected(right, tmp_path, edit).startswith(why)


@pytest.mark.parametrize("name", EDITS)
def test_what_overstates_is_rejected(name: str, right: Path, tmp_path: Path) -> None:
    assert rejected(right, tmp_path, EDITS[name])


EDITS_OF_USERS: dict[str, Edit] = {
    "a bolder ttf": lambda c: c.program("abs(motion.x) > 0.7", "abs(motion.x) > 1.4"),
    "a ttf that forgets speed": lambda c: c.program(" || abs(motion.v) > 0.8", ""),
    "a bolder safer": lambda c: c.program("safer abs(motion.x) < 0.6", "safer abs(motion.x) < 1.4"),
    "a smaller safer": lambda c: c.program(
        "safer abs(motion.x) < 0.6", "safer abs(motion.x) < 0.4"
    ),
    "R is larger": lambda c: c.matrix(c.group["R"]["faces"], out(1e-3)),
    "no R": lambda c: c.matrix(c.group["R"]["faces"], lambda m: m[:0]),
    "the target is larger": lambda c: c.matrix(c.group["target"]["box"], scaled(1.1)),
    "no target": lambda c: c.group.pop("target"),
    "no Q": lambda c: c.group.pop("Q"),
    "the time is shorter": lambda c: c.program("within 30s", "within 1s", recover_ns=10**9),
    "fewer holds": lambda c: c.group.update(periods=c.group["periods"] // 2),
}


@pytest.mark.parametrize("name", some(EDITS_OF_USERS, 1))
@pytest.mark.long
def test_what_overstates_predicates_is_rejected(name: str, users: Path, tmp_path: Path) -> None:
    assert rejected(users, tmp_path, EDITS_OF_USERS[name])


def parts_of(group: dict[str, Any]) -> list[tuple[str, int]]:
    return [
        (name, k)
        for name, records in group["multipliers"].items()
        for k, m in enumerate(records)
        if m["shape"][0]
    ]


@pytest.mark.parametrize("factor", some([-1.0, 0.9, 1.1], 1))
def test_every_claim_rests_on_its_multipliers(factor: float, right: Path, tmp_path: Path) -> None:
    """Claims with room to spare survive a worse bound; none survives a negative multiplier."""
    total, held = 0, []
    for number, (name, k) in enumerate(parts_of(Opened(right).group)):
        at = Opened(shutil.copytree(right, tmp_path / str(number)))
        at.matrix(at.group["multipliers"][name][k], weights(factor))
        total += 1
        if checked(at.seal()).accepted:
            held.append((name, k))
    assert total > 10
    assert len(held) <= (0 if factor <= 0 else 2), held


@pytest.mark.long
def test_a_half_space_of_k_that_is_moved_out_is_rejected(right: Path, tmp_path: Path) -> None:
    """Each of them that any claim uses."""
    group = Opened(right).group
    used = set()
    for name in ("K", "Q"):
        for m in group["multipliers"][name]:
            data = np.frombuffer((right / m["file"]).read_bytes(), dtype="<f8").reshape(m["shape"])
            if m["of"][1] == group["K"]["faces"]["shape"][0]:
                used |= {int(face) for face in data[:, 1]}
    chance = np.random.default_rng(1)
    for face in chance.choice(sorted(used), size=min(12, len(used)), replace=False):
        at = Opened(shutil.copytree(right, tmp_path / str(face)))

        def change(m: Any, face: int = face) -> Any:
            m[face, -1] += 0.02
            return m

        at.matrix(at.group["K"]["faces"], change)
        assert not checked(at.seal()).accepted, face


# ---------------------------------------------------------------- a prover that is wrong


def _nothing(_: object, rows: Any, *__: object) -> Any:
    return np.zeros(rows.mid.shape[0])


HOLES: dict[str, tuple[object, str, object]] = {
    "outputs are never late": (polytope_model.Hold, "_exchange_loss", _nothing),
    "reads are fresh": (
        polytope_model.Hold,
        "_read_error",
        lambda self: np.abs(self.group.gain) @ self.group.error,
    ),
    "reads are exact": (polytope_model.Hold, "_read_error", lambda self: np.zeros(len(self.rate))),
    "nothing disturbs": (
        polytope_model.TimeGrid,
        "noise",
        lambda self, rows, _: np.zeros((len(self.times_ns), rows.mid.shape[0])),
    ),
    "nothing happens between instants": (polytope_model.LinearGroup, "sagging", _nothing),
    "estimates are exact": (polytope_extract, "errors_of", lambda _: {}),
    "thresholds are not lowered": (tables, "thresholds", lambda p: p.bounds),
}


@pytest.mark.parametrize("name", some(HOLES, 3))
def test_a_prover_with_a_hole_is_caught(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(*HOLES[name])
    path = tmp_path / "cart.soter"
    path.write_text(program())
    soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    report = checked(tmp_path / "cert")
    assert not report.accepted
    assert report.reason


# ---------------------------------------------------------------- work


def many_periods(at: Opened) -> None:
    at.group["periods"] = 99_999


def many_instants(at: Opened) -> None:
    end = at.group["instants"]["hold"][-1]
    at.group["instants"]["hold"] = [end * k // 999 for k in range(1000)]


def many_rows(at: Opened) -> None:
    at.group["multipliers"]["K"][0]["of"][0] = 1 << 24


@pytest.mark.parametrize(
    ("how", "why"),
    [(many_periods, "more work"), (many_instants, "more work"), (many_rows, "not looked at")],
)
def test_what_asks_for_too_much_work_is_refused_at_once(
    how: Edit, why: str, right: Path, tmp_path: Path
) -> None:
    at = Opened(shutil.copytree(right, tmp_path / "much"))
    how(at)
    sealed = at.seal()
    report, calls = work_of(lambda: checked(sealed))
    assert why in report.reason
    assert calls <= CALLS_MAX


# ---------------------------------------------------------------- what plants publish

BEFORE = "topic dial: float in [-50.0, 50.0];\ntopic bent: float in [-600.0, 600.0];\n"
DIAL = (
    (
        "topic motion: Motion max_age",
        f"{BEFORE}topic motion: Motion max_age",
    ),
    (
        "  drives motion = { x: x, v: v };",
        "  drives motion = { x: x, v: v };\n  drives dial = x + v;\n  drives bent = x * v;",
    ),
)


def greatest_in_core(folder: Path) -> float:
    """Of x + v in K, by the vertices where two of its faces meet."""
    core = Opened(folder).group["K"]
    box, faces = (
        np.fromfile(folder / core[k]["file"], dtype="<f8").reshape(core[k]["shape"])
        for k in ("box", "faces")
    )
    rows = np.vstack([faces[:, :2], np.eye(2), -np.eye(2)])
    ends = np.concatenate([faces[:, 2], box[1], -box[0]])
    greatest = -np.inf
    for i in range(len(rows)):
        for j in range(i):
            if abs(np.linalg.det(rows[[i, j]])) > 1e-9:
                x = np.linalg.solve(rows[[i, j]], ends[[i, j]])
                if (rows @ x <= ends + 1e-9).all():
                    greatest = max(greatest, float(x.sum()))
    return greatest


def test_what_is_published_of_half_spaces_is_shown_over_k_and_what_sc_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The box of C reaches to 7.5, K less far; multipliers come from nowhere but here."""
    folder, report = written(tmp_path, program(*DIAL))
    assert report.verdict == "proved"
    most = greatest_in_core(folder)
    assert 1.0 < most < 2.4

    def shown_with(bound: float, name: str, topic: str = "dial", now: float = 50.0) -> bool:
        other = tmp_path / name
        shutil.copytree(folder, other)
        at = Opened(other)
        at.program(f"[-{now}, {now}]", f"[-{bound!r}, {bound!r}]")
        report = checked(at.seal())
        if not report.accepted:
            assert report.verdict == "not re-checked"
            assert f"`{topic}`" in report.reason
            return False
        assert f"set {topic}" in {s.key for s in report.modules[0].shown}
        assert f"set {topic}" not in {s.key for s in report.said}
        return True

    assert shown_with(2.5, "wide")
    assert not shown_with(0.01, "bent", "bent", 600.0)
    assert not shown_with(most * 0.999, "narrow")
    monkeypatch.setitem(sys.modules, "highspy", None)
    assert not shown_with(2.5, "without_hints")
    assert shown_with(8.0, "by_the_box")


# ---------------------------------------------------------------- what only cells would show

STILL = (
    ("type Motion = { x: float, v: float };", "type Motion = { x: float };"),
    ("{ x: x, v: v }", "{ x: x }"),
    ("  state v: float = 0.0;\n", ""),
    ("  der x = v;\n", ""),
    ("der v = accel + wind;", "der x = accel - x + wind;"),
    ("measured motion.x within 0.02, motion.v within 0.05;", "measured motion.x within 0.02;"),
    ("(goal - motion.x) - motion.v, -A, A)", "(goal - motion.x), -A, A)"),
    ("-2.0 * motion.x - 2.5 * motion.v", "-2.0 * motion.x"),
    ("motion.x in [-2.0, 2.0], motion.v in [-6.0, 6.0];", "motion.x in [-2.0, 2.0];"),
    ("safe abs(motion.x) < WALL;", "safe abs(motion.x) < WALL;\n  failsafe accel = 0.0;"),
)
GUST = (
    ("topic accel:", "topic gust: float in [-9.0, 9.0] max_age 10ms;\ntopic accel:"),
    ("drives motion = { x: x };", "drives motion = { x: x };\n  drives gust = SENT;"),
    ("state x: float = 0.0;", "state x: float = 0.0;\n  state k: int in [1, 2] = 1;"),
)


@pytest.mark.parametrize(
    ("sent", "whole"),
    [("2.0", False), ("k == 1 ? 0.0 : WALL", False), ("0.3 - 0.3 * WALL", True)],
)
def test_what_is_published_and_reads_no_state_lies_in_its_set_too(
    sent: str, whole: bool, tmp_path: Path
) -> None:
    """It is asked of the start as well: so nothing is claimed of that."""
    folder, _ = written(tmp_path, program(*STILL, *GUST, ("SENT", sent)))
    at = Opened(folder)
    at.entry["claims"]["start"] = "undecided"
    for case in at.entry["cases"]:
        del case["groups"][0]["instants"]["start"]
    at.program("[-9.0, 9.0]", "[-0.5, 0.5]")
    report = checked(at.seal())
    assert report.accepted == whole, report.reason
    assert whole or "`gust` lies in its declared set" in report.reason


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, report = written(tmp_path_factory.mktemp("still"), program(*STILL))
    assert report.modules[0].findings["failsafe"].verdict == "undecided"
    return folder


def test_a_law_on_cells_is_none_for_polytopes(still: Path, tmp_path: Path) -> None:
    """K_fs is a core of the law, and K of the polytope is larger: nothing compares them."""

    def edit(at: Opened) -> None:
        edges = np.linspace(-2.0, 2.0, 41)
        inside = (edges[:-1] >= -0.55) & (edges[1:] <= 0.55)
        for name, data in (("edges", edges.astype("<f8")), ("K", inside.astype(np.uint8))):
            (at.folder / "sets" / f"law_{name}.bin").write_bytes(data.tobytes())
            at.manifest["files"][f"sets/law_{name}.bin"] = ""
        axis = {"state": at.entry["inputs"][0]["name"], "edges": "sets/law_edges.bin"}
        group = {"kind": "grid", "axes": [axis], "K": "sets/law_K.bin"}
        at.entry["law"] = [{"parameter": [], "groups": [group]}]
        at.entry["claims"]["failsafe"] = "proved"

    reason = "SafeCart: a fail-safe law on polytopes is not rechecked"
    assert rejected(still, tmp_path, edit) == reason


def test_a_shield_is_none_of_polytopes(still: Path, tmp_path: Path) -> None:
    def edit(at: Opened) -> None:
        at.program("  safe abs", "  shield 4;\n  safe abs")

    assert rejected(still, tmp_path, edit) == "SafeCart: a shield beside polytopes"


def test_a_box_on_which_a_predicate_is_not_certain_is_refused() -> None:
    nothing: Any = None
    check = PolytopeCheck(nothing, nothing)
    cells = Cells(Grid(((0.0, 1.0),)), np.zeros(1, dtype=np.bool_))
    for asked, name in ((check.note_safe_cells, "safe"), (check.show_return, "safer")):
        with pytest.raises(RejectedError, match=f"`{name}` is not certain on the box"):
            asked(cells)


@pytest.mark.parametrize(
    ("held", "why"),
    [
        ({}, ""),
        ({"outer": HalfSpaces((-1.1,), (1.0,), (), ())}, "box is larger"),
        ({"inner": HalfSpaces((-0.5,), (0.6,), ((1.0,),), (0.2,))}, "box is larger"),
        ({"inner": HalfSpaces((-0.5,), (0.5,), (), ())}, "does not hold the half-spaces"),
        (
            {"inner": HalfSpaces((-0.5,), (0.5,), ((1.0,),), (0.3,))},
            "does not hold the half-spaces",
        ),
    ],
)
@pytest.mark.parametrize("wide", [0, 1])
def test_what_a_dm_lets_through_lies_in_the_sets_of_every_case(
    held: dict[str, HalfSpaces], why: str, wide: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`wide`: the case whose sets are so large that they do not matter. Rounding counts."""
    kept = {
        "outer": HalfSpaces((-1.0,), (1.0,), (), ()),
        "inner": HalfSpaces((-0.5,), (0.5,), ((1.0,),), (0.2,)),
    } | held
    monkeypatch.setattr(polytope_group, "read_half_spaces", lambda _, name, __: kept[name])
    facts: Any = SimpleNamespace(
        states=[SimpleNamespace(name="x")], symbol=SimpleNamespace(shield=None)
    )
    large = HalfSpaces((-9.0,), (9.0,), (), ())
    sets = [HalfSpaces((-1.0,), (1.0,), (), ()), HalfSpaces((-0.5,), (0.5,), ((1.0,),), (0.3,))]
    levels: Any = [[large, large] if k == wide else sets for k in (0, 1)]
    cases = [PolytopeGroup(SimpleNamespace(states=(0,), levels=of)) for of in levels]  # type: ignore[arg-type]
    entry = {"states": ["x"], "outer": "outer", "inner": "inner"}
    if why:
        with pytest.raises(RejectedError, match=why):
            cases[0].compare(facts, facts, cases, entry)
    else:
        cases[0].compare(facts, facts, cases, entry)
        assert all(g.tables.gives_back for g in cases)
