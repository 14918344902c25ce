"""`soter assure`: supported is what was checked now, and nothing else."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import SCHEMAS, _check
from soter.api import load

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
SMALL = (
    ("/ 400", "/ 100"),
    ("/ 320", "/ 80"),
    ("tau * tau) + 0.12", "tau * tau) + 0.8"),
    ("soter 1;", "soter 1;\nparam GAIN: float = 1.0 in [0.5, 2.0];"),
    ("publish accel = clamp(4.0 *", "publish accel = clamp(GAIN * 4.0 *"),
)
MORE = """
plant Bench period 50ms {
  reads accel; drives motion = { x: x, v: 0.0 }; state x: float = 0.0; next x = x;
}
node Hold period 10ms { publishes accel; step { publish accel = 0.0; } }
system Still { b: Bench; module SafeCart; until 1s; }
test Quiet { system Still; replace Fast by Hold; horizon 100ms; always abs(motion.x) < WALL; }
test Loud { system Still; replace Fast by Hold; horizon 100ms; always abs(motion.x) > WALL; }
"""
PROOF = ["P1a", "P1b", "P1c", "P2a", "P3", "ttf", "safer", "start"]


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small cart and its certificate."""
    folder = tmp_path_factory.mktemp("proved")
    text = CART.read_text() + MORE
    for old, new in SMALL:
        assert old in text
        text = text.replace(old, new)
    (folder / "c.soter").write_text(text)
    report = load(folder / "c.soter").verify(
        system="Protected", cert=folder / "proof", refute=False
    )
    assert report.verdict == "proved"
    return folder


@pytest.fixture
def cart(proved: Path, here: Path) -> Path:
    shutil.copytree(proved, here, dirs_exist_ok=True)
    return here


def case_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / "case.json").read_text())
    assert list(_check(SCHEMAS["case"], found, "")) == []
    ids = {n["id"] for n in found["nodes"]}
    for n in found["nodes"]:
        assert ids.issuperset(n["supported_by"] + n["in_context_of"])
    return found


def assured(soter: Soter, *arguments: str) -> tuple[int, dict[str, str]]:
    done = soter("assure", "c.soter", *arguments, "-o", "out", "--json")
    return done.exit, done.document["goals"]


def whys(folder: Path) -> str:
    return "\n".join(n["why"] for n in case_of(folder)["nodes"])


def test_a_certificate_of_exactly_this_supports_the_top_goal(soter: Soter, cart: Path) -> None:
    code, goals = assured(soter, "--cert", "proof")
    assert code == 0
    assert list(goals) == ["G1", "G1.1", *(f"G1.1.{p}" for p in PROOF)]
    assert set(goals.values()) == {"supported"}
    case = case_of(cart)
    solutions = [n for n in case["nodes"] if n["kind"] == "solution"]
    assert len({n["sha256"] for n in solutions}) == 1
    assert solutions[0]["sha256"] in (cart / "proof" / "SEAL").read_text()
    assert sum(n["kind"] == "assumption" for n in case["nodes"]) > 5
    page = (cart / "out" / "index.html").read_text()
    assert "Supported" in page
    assert all(n["id"] in page for n in case["nodes"])
    again = {p.name: p.read_bytes() for p in (cart / "out").iterdir()}
    assured(soter, "--cert", "proof")
    assert again == {p.name: p.read_bytes() for p in (cart / "out").iterdir()}


def test_without_a_certificate_nothing_is_supported(soter: Soter, cart: Path) -> None:
    code, goals = assured(soter)
    assert (code, set(goals.values())) == (4, {"undeveloped"})
    assert "no certificate was given" in whys(cart)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("program", "the certificate is of another program"),
        ("parameter", "about other values of the parameters"),
        ("system", "is not about this module of this system"),
        ("forced", "is forced to AC"),
    ],
)
def test_a_certificate_of_anything_else_supports_nothing(
    soter: Soter, cart: Path, change: str, why: str
) -> None:
    more: tuple[str, ...] = ()
    if change == "program":
        (cart / "c.soter").write_text((cart / "c.soter").read_text() + " ")
    if change == "parameter":
        more = ("--set", "GAIN=1.5")
    if change in ("system", "forced"):
        more = ("--system", {"system": "Still", "forced": "Unprotected"}[change])
    code, goals = assured(soter, "--cert", "proof", *more)
    assert (code, set(goals.values())) == (4, {"undeveloped"})
    assert why in whys(cart)


def test_a_certificate_that_was_changed_is_rejected(soter: Soter, cart: Path) -> None:
    table = max((cart / "proof" / "sets").rglob("*"), key=lambda p: p.is_file())
    table.write_bytes(b"\0" + table.read_bytes()[1:] + b"\0")
    code, goals = assured(soter, "--cert", "proof")
    assert (code, set(goals.values())) == (3, {"undeveloped"})
    assert "the certificate is rejected" in whys(cart)


def test_tests_count_only_where_they_are_explored_now(soter: Soter, cart: Path) -> None:
    report = soter("test", "c.soter", "--test", "Quiet", "--json")
    assert report.exit == 0
    (cart / "tests.json").write_text(report.out)
    code, goals = assured(soter, "--cert", "proof", "--test-report", "tests.json")
    assert (code, goals["G1"], goals["G2.1"]) == (0, "supported", "undeveloped")
    assert "the report says exhausted of this program; it was not explored again" in whys(cart)
    code, goals = assured(soter, "--tests")
    assert (code, goals["G2"], goals["G2.1"], goals["G2.2"]) == (
        3,
        "undeveloped",
        "supported",
        "undeveloped",
    )
    document = json.loads((cart / "tests.json").read_text())
    (cart / "tests.json").write_text(json.dumps({**document, "program_sha256": "0" * 64}))
    assured(soter, "--test-report", "tests.json")
    assert "the report is about another program" in whys(cart)


def test_flights_count_where_they_are_flown_again(soter: Soter, cart: Path) -> None:
    assert soter("campaign", "c.soter", "--flights", "6", "--until", "2s", "-o", "fly").exit == 0
    code, goals = assured(soter, "--campaign", "fly", "--flights", "3")
    assert (code, goals["G3"]) == (4, "supported")
    assert any("3 flights flown again" in n["text"] for n in case_of(cart)["nodes"])
    assert assured(soter, "--campaign", "fly", "--flights", "0")[1]["G3"] == "undeveloped"
    rows = (cart / "fly" / "flights.csv").read_text().splitlines()
    head = rows[0].split(",")
    cells = rows[1].split(",")
    cells[head.index("digest")] = "0" * len(cells[head.index("digest")])
    (cart / "fly" / "flights.csv").write_text(
        "\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n"
    )
    assert assured(soter, "--campaign", "fly")[1]["G3"] == "undeveloped"
    assert "flight 0 is another one" in whys(cart)


def test_what_is_no_evidence_is_told_in_words(soter: Soter, cart: Path) -> None:
    (cart / "tests.json").write_text("[]")
    run = ("assure", "c.soter", "-o", "out", "--json")
    assert soter(*run, "--test-report", "tests.json").codes == ["D005"]
    assert soter(*run, "--test-report", "none.json").codes == ["D006"]
    assert soter(*run, "--campaign", "none").codes == ["D006"]
    assert soter(*run, "--cert", "none").codes == ["D009"]
    (cart / "file").write_text("in the way")
    assert soter("assure", "c.soter", "-o", "file", "--json").codes == ["D006"]


def test_the_document_of_strictdoc_names_every_parent(soter: Soter, cart: Path) -> None:
    assured(soter, "--cert", "proof")
    text = (cart / "out" / "case.sdoc").read_text()
    assert text.startswith("[DOCUMENT]\nTITLE: ")
    requirements = text.split("[REQUIREMENT]\n")[1:]
    case = case_of(cart)
    judged = [n for n in case["nodes"] if n["kind"] in ("goal", "strategy", "solution")]
    assert len(requirements) == len(judged)
    for n, written in zip(judged, requirements, strict=True):
        assert written.startswith(f"UID: {n['id']}\nSTATUS: {n['status']}\n")
        parents = [p["id"] for p in case["nodes"] if n["id"] in p["supported_by"]]
        assert [f"  VALUE: {p}" in written for p in parents] == [True] * len(parents)
        assert written.count("- TYPE: Parent") == len(parents)
    assert text.count("<<<") == text.count(">>>")
