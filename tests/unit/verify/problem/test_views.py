"""A module that is proved one wall at a time: in all of its views, or not at all."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
from contextlib import nullcontext
from typing import TYPE_CHECKING

import pytest

from generators.corridor_program import LAW, SAFE, SET, VIEWS, program
from soter.api import load
from soter.certificate.extras.views import module_in_view, why_views_leave_out
from soter.certificate.reading.problem import read_facts
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_of
from soter.language.model import typed
from soter.verify.problem.problem import assumption_texts
from soter.verify.proof_report import proof_page
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import VerifyReport


def verified(folder: Path, cert: str | None = None, **parts: str) -> VerifyReport:
    path = folder / "cart.soter"
    path.write_text(program(**parts), encoding="utf-8")
    return load(path).verify(cert=None if cert is None else folder / cert)


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, VerifyReport]:
    folder = tmp_path_factory.mktemp("views")
    return folder / "cert", verified(folder, "cert")


def test_every_view_is_proved_and_so_is_the_module(proved: tuple[Path, VerifyReport]) -> None:
    report = proved[1]
    assert [m.name for m in report.modules] == ["Keep as left", "Keep as right"]
    assert [m.verdict for m in report.modules] == ["proved", "proved"]
    assert report.verdict == "proved"
    for m in report.modules:  # the cell up to an open end counts as the others
        assert m.shares["gives_back"] < m.shares["lets_ac"] < m.shares["free"] < 0.9
    assert all("seen.r below 60.0" in assumption_texts(m.assumptions)[-1] for m in report.modules)


@all_rows(
    ("parts", "view", "why"),
    [
        ({}, "left", ""),
        ({}, "middle", "module `Keep` has no view `middle`"),
        ({}, "", "`Keep` is proved in views"),
        ({"ttf": "", "safer": ""}, "left", "predicates that are computed, in several views"),
    ],
)
def test_the_re_checker_reads_a_module_in_one_of_its_views(
    tmp_path: Path, parts: dict[str, str], view: str, why: str
) -> None:
    (tmp_path / "cart.soter").write_text(program(**parts), encoding="utf-8")
    flat = system_of(check_file(str(tmp_path / "cart.soter")), None, {}, exact=False)
    with pytest.raises(NotRecheckedError, match=why) if why else nullcontext():
        read_facts(flat, "Keep", view)


def test_the_re_checker_accepts_it(proved: tuple[Path, VerifyReport]) -> None:
    recheck_report = recheck(proved[0])
    assert recheck_report.accepted, recheck_report.reason
    assert recheck_report.safe
    assert [m.name for m in recheck_report.modules] == ["Keep as left", "Keep as right"]
    open_ends = [
        a.key for m in recheck_report.modules for a in m.assumptions if a.key.startswith("open")
    ]
    assert open_ends == ["open seen.r 60.0"] * 2


def sealed(folder: Path, manifest: dict[str, object]) -> None:
    raw = (json.dumps(manifest, sort_keys=True, separators=(",", ":")) + "\n").encode()
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n", encoding="ascii")


@pytest.mark.parametrize("which", [0, 1])
def test_a_certificate_without_one_of_the_views_is_rejected(
    proved: tuple[Path, VerifyReport], tmp_path: Path, which: int
) -> None:
    folder = tmp_path / "cert"
    shutil.copytree(proved[0], folder)
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    gone = manifest["modules"].pop(which)
    name = "left" if which == 0 else "right"
    assert gone["view"] == name
    for path in list(manifest["files"]):
        if path.startswith(f"sets/{which}_"):
            del manifest["files"][path]
            (folder / path).unlink()
    sealed(folder, manifest)
    recheck_report = recheck(folder)
    assert not recheck_report.accepted
    assert f"view `{name}` of module `Keep` is not there" in recheck_report.reason


@pytest.mark.long
def test_a_certificate_in_which_a_view_stands_twice_is_rejected(
    proved: tuple[Path, VerifyReport], tmp_path: Path
) -> None:
    folder = tmp_path / "cert"
    shutil.copytree(proved[0], folder)
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["modules"][1] = manifest["modules"][0]
    sealed(folder, manifest)
    assert not recheck(folder).accepted


@pytest.mark.parametrize(
    ("parts", "bad"),
    [
        ({"law": LAW.replace("elseif along.low < MARGIN { gap = MARGIN - along.low; }", "")}, 0),
        ({"law": "gap = 1.0;"}, 1),
        ({"ttf": "ttf !Fits(left, 0.05);"}, 1),
        ({"ttf": "ttf !(Fits(left, 0.05) || Fits(right, 0.05));"}, 0),
        ({"safer": "safer Fits(left, 0.08) && right.room > 0.0;"}, 1),
        ({"views": VIEWS.replace("4.02] / 100 open to 60.0", "4.02] / 100", 1)}, 0),
    ],
    ids=["no left wall", "into the right", "ttf of one", "either is enough", "safer", "closed"],
)
def test_what_one_view_cannot_show_is_not_proved(
    tmp_path: Path, parts: dict[str, str], bad: int
) -> None:
    report = verified(tmp_path, **parts)
    assert report.modules[bad].verdict == "undecided"
    assert report.verdict == "undecided"


@pytest.mark.parametrize(
    ("parts", "text"),
    [
        ({"safe": "safe left.room + right.room >= 0.0;"}, "no view speaks of this part of `safe`"),
        ({"safer": "safer left.room > right.room;"}, "no view speaks of this part of `safer`"),
        ({"ttf": "", "safer": ""}, "module `Keep` has views and no `ttf`"),
        ({"views": VIEWS + "view more { }"}, "view `more` has no plant"),
        ({"views": VIEWS + SET.format(name="left")}, ""),
        ({"views": VIEWS.split("view right")[0]}, "no view speaks of this part of `safe`"),
    ],
)
def test_views_that_are_not_the_module_are_refused(
    tmp_path: Path, parts: dict[str, str], text: str
) -> None:
    with pytest.raises(SoterError) as error:
        verified(tmp_path, **parts)
    if text:
        assert text in [d.message for d in error.value.diagnostics]


def random_predicate(chance: random.Random, depth: int) -> str:
    if depth == 0 or chance.random() < 0.2:
        wall = chance.choice(("left", "right"))
        return f"{wall}.room >= {chance.randint(-2, 2)}.5"
    op = chance.choice(("&&", "||", "!"))
    if op == "!":
        return f"!({random_predicate(chance, depth - 1)})"
    return f"({random_predicate(chance, depth - 1)} {op} {random_predicate(chance, depth - 1)})"


@pytest.mark.long
def test_a_predicate_in_a_view_never_says_more_than_the_whole() -> None:
    """By definition: for every value of the rest, what holds of the whole holds of its part.

    The prover's parts and the re-checker's are both held to that; neither reads the other's.
    """
    chance = random.Random(5)  # noqa: S311
    kept = 0
    for k in range(150):
        ttf, safer, safe = (random_predicate(chance, 3) for _ in range(3))
        text = program(ttf=f"ttf {ttf};", safer=f"safer {safer};", safe=f"safe {safe};")
        checked = check_file("cart.soter", text)
        assert checked.ok, checked.diagnostics
        flat = system_of(checked, "S")
        module = flat.modules[0]
        try:
            views = systems_by_view(flat, module)
        except SoterError:
            continue  # the re-checker takes more apart, and is not asked then
        assert not why_views_leave_out(module.symbol, ["left", "right"])
        kept += 1
        for parts in (
            [own.symbol for _, own in views],
            [module_in_view(module, name).symbol for name in ("left", "right")],
        ):
            _never_more(module.symbol, parts, k)
    assert kept > 5


def _never_more(whole: typed.ModuleSymbol, parts: list[typed.ModuleSymbol], seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311
    for _ in range(40):
        rooms = {name: chance.uniform(-3.0, 3.0) for name in ("left", "right")}
        if any(holds(p.ttf, rooms) for p in parts):
            assert holds(whole.ttf, rooms), "a view takes AC's control where the module does not"
        assert all(holds(p.safer, rooms) for p in parts) == holds(whole.safer, rooms)
        assert all(holds(p.safe, rooms) for p in parts) == holds(whole.safe, rooms)


def holds(e: typed.TypedExpr | None, rooms: dict[str, float]) -> bool:
    """The meaning of what `random_predicate` writes, once more."""
    if isinstance(e, typed.TypedUnary):
        return not holds(e.operand, rooms)
    if isinstance(e, typed.TypedBinary) and e.op in ("&&", "||"):
        both = holds(e.left, rooms), holds(e.right, rooms)
        return all(both) if e.op == "&&" else any(both)
    if isinstance(e, typed.TypedBinary):
        assert e.op == ">="
        return number(e.left, rooms) >= number(e.right, rooms)
    assert isinstance(e, typed.Literal)
    return e.value is True


def number(e: typed.TypedExpr, rooms: dict[str, float]) -> float:
    if isinstance(e, typed.Literal):
        return float(e.value)
    if isinstance(e, typed.TypedUnary):
        return -number(e.operand, rooms)
    assert isinstance(e, typed.TypedField)
    assert isinstance(e.target, typed.TopicRead)
    return rooms[e.target.topic.name]


@pytest.mark.long
def test_what_only_safe_reads_is_said_to_be_judged_on_the_plant_of_the_proof(
    tmp_path: Path,
) -> None:
    text = (
        program(safe=SAFE.replace(";", " && danger <= 1.0;"))
        .replace("topic push:", "topic danger: float in [-100.0, 100.0] max_age 11ms;\ntopic push:")
        .replace("drives left = ", "drives danger = 0.0;\n  drives left = ")
        .replace("publishes left, right, along;", "publishes left, right, along, danger;")
        .replace("publish left = ", "publish danger = motion.x * 10.0;\n    publish left = ")
    )
    (tmp_path / "cart.soter").write_text(text, encoding="utf-8")
    report = load(tmp_path / "cart.soter").verify(cert=tmp_path / "cert")
    words = "what `safe` says of danger is judged on what seen drives"
    said = ["".join(assumption_texts(m.assumptions)) for m in report.modules]
    assert [words in text for text in said] == [True, False]
    recheck_report = recheck(tmp_path / "cert")
    assert [
        a.key for m in recheck_report.modules for a in m.assumptions if a.key.startswith("judged")
    ] == ["judged danger seen"]


@pytest.mark.parametrize(
    ("end", "code"),
    [("4.02", "V001"), ("3.0", "V001"), ("1e308", "R010"), ("1e6", ""), ("1.0 / 0.0", "T020")],
)
def test_an_open_end_lies_beyond_the_grid(tmp_path: Path, end: str, code: str) -> None:
    text = program(views=VIEWS.replace("open to 60.0", f"open to {end}", 1))
    (tmp_path / "cart.soter").write_text(text, encoding="utf-8")
    try:
        load(tmp_path / "cart.soter").verify(refute=False)
    except SoterError as error:
        codes = [d.code for d in error.diagnostics]
    else:
        codes = []
    assert codes == ([code] if code else [])


def test_the_page_names_the_module_once_and_draws_what_matters(
    proved: tuple[Path, VerifyReport],
) -> None:
    report_page = proof_page(proved[1])
    assert report_page.headline.startswith("Keep in 2 views: proved")
    figure = report_page.modules[0].figures[0]
    assert max(figure.x_edges) < 4.1, "not up to the open end"
    assert "seen.r goes on to 60" in figure.note
    assumed = [r for r in report_page.modules[0].properties if r.verdict == "assumed"]
    assert [(r.name, r.method) for r in assumed] == [("failsafe", "none")]
    assert f"under {len(report_page.assumptions)} assumptions" in report_page.headline
    assert not any("not covered" in text for text in report_page.assumptions)
