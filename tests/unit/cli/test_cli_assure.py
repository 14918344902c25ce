"""`soter assure`: supported is what was checked now, and nothing else."""

from __future__ import annotations

import csv
import hashlib
import json
import shlex
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import SCHEMAS, _check
from soter.api import load
from soter.api.assurance.certificate_check import rechecker_sha256
from soter.certificate.reading.folder import canonical_json
from soter.certificate.report import ACCEPTED, RecheckAssumption, RecheckedModule, Report
from soter.native.cache import soter_sha256
from soter.native.compiler import compiler_version, find_compiler
from soter.version import VERSION
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

HAZARDS = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart_hazards.csv"
CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
SMALL = (
    ("/ 400", "/ 60"),
    ("/ 320", "/ 48"),
    ("tau * tau) + 0.12", "tau * tau) + 1.2"),
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
CONTRACTS = """soter 1;
input topic go: int in [0, 3] = 0;
topic u: int in [0, 3];
topic w: int in [0, 3];
node Say period 10ms { publishes u; guarantees u < 3; step { publish u = choose [0, 2]; } }
node Hear period 10ms { subscribes u; publishes w; step { publish w = u; } }
node Obey period 10ms { subscribes go; publishes w; step { publish w = go; } }
system Told default { node Obey; until 1s; }
system Spoken { node Say; node Hear; until 1s; }
test Undriven { system Told; horizon 30ms; always w < 3; }
test Rests { system Spoken; replace Say by contract; horizon 30ms; always w < 3; }
"""
pytestmark = pytest.mark.usefixtures("equal_certificates_are_checked_once")
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
    case: dict[str, Any] = json.loads((folder / "out" / "case.json").read_text())
    assert list(_check(SCHEMAS["case.json"], case, "")) == []
    ids = {n["id"] for n in case["nodes"]}
    for n in case["nodes"]:
        assert ids.issuperset(n["supported_by"] + n["in_context_of"])
    return case


def assured(soter: Soter, *arguments: str) -> tuple[int, dict[str, str]]:
    done = soter("assure", "c.soter", *arguments, "-o", "out", "--json")
    return done.exit, done.document["goals"]


def whys(folder: Path) -> str:
    return "\n".join(n["why"] for n in case_of(folder)["nodes"])


def test_a_certificate_of_exactly_this_supports_the_top_goal(soter: Soter, cart: Path) -> None:
    code, goals = assured(soter, "--cert", "proof")
    assert code == 0
    proof = ["G1", "G1.1", *(f"G1.1.{p}" for p in PROOF), "G4", "G4.1"]
    assert list(goals) == [*proof, "G5", "G5.1", "G6", "G6.1"]
    assert {g for g, status in goals.items() if status != "supported"} == {"G5", "G5.1"}
    case = case_of(cart)
    assert "for as long as its trusted part runs" in case["nodes"][0]["text"], "there is no law"
    assert "no fail-safe law is declared" in whys(cart)
    assert not any("compiled" in n["text"] for n in case["nodes"] if n["kind"] == "context")
    solutions = [n for n in case["nodes"] if n["kind"] == "solution" and n["sha256"]]
    assert len(solutions) == len(PROOF) + 1
    assert len({n["sha256"] for n in solutions}) == 1
    assert solutions[0]["sha256"] in (cart / "proof" / "SEAL").read_text()
    assert sum(n["kind"] == "assumption" for n in case["nodes"]) > 5
    page = (cart / "out" / "index.html").read_text()
    assert "Supported" in page
    assert all(n["id"] in page for n in case["nodes"])


@pytest.mark.parametrize("given", [(), pytest.param(("--cert", "proof"), marks=pytest.mark.long)])
def test_the_same_case_is_made_twice(soter: Soter, cart: Path, given: tuple[str, ...]) -> None:
    made = []
    for _ in range(2):
        assured(soter, *given)
        made.append({p.name: p.read_bytes() for p in (cart / "out").iterdir()})
    assert made[0] == made[1]


def test_without_a_certificate_nothing_is_supported(soter: Soter, cart: Path) -> None:
    code, goals = assured(soter, "--set", "GAIN=1.5")
    assert (code, set(goals.values())) == (4, {"undeveloped"})
    assert "no certificate was given" in whys(cart)
    told = case_of(cart)["provenance"]
    assert told["certificate"] == "no certificate was given (--cert DIR)"
    assert told["C compiler"] == "none: no decision module was compiled for this case"
    before = (cart / "out" / "case.json").read_bytes()
    assert soter(*shlex.split(told["command"])[1:]).exit == 4
    assert (cart / "out" / "case.json").read_bytes() == before, "the command makes it again"


@pytest.fixture
def unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody asks the re-checker: what is wrong is found before."""

    def asked(*_: object) -> None:
        raise AssertionError("the claims of a certificate that is wrong were checked")

    monkeypatch.setattr("soter.api.assurance.certificate_check.recheck", asked)


@pytest.mark.usefixtures("unasked")
@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("program", "the hashes differ; SafeCart poses the same problem"),
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


@pytest.mark.usefixtures("unasked")
def test_a_certificate_that_was_changed_is_rejected(soter: Soter, cart: Path) -> None:
    table = max((cart / "proof" / "sets").rglob("*"), key=lambda p: p.is_file())
    table.write_bytes(b"\0" + table.read_bytes()[1:] + b"\0")
    code, goals = assured(soter, "--cert", "proof")
    assert (code, set(goals.values())) == (3, {"undeveloped"})
    assert "the certificate is rejected" in whys(cart)


@pytest.mark.usefixtures("unasked")
def test_a_manifest_that_says_our_hash_of_another_program_is_rejected(
    soter: Soter, cart: Path
) -> None:
    theirs = (cart / "c.soter").read_text().replace("abs(motion.x) < WALL", "abs(motion.x) > WALL")
    (cart / "proof" / "program" / "c.soter").write_text(theirs)
    sha256 = hashlib.sha256(theirs.encode()).hexdigest()
    forged(cart, lambda m: m["files"].update({"program/c.soter": sha256}))
    code, goals = assured(soter, "--cert", "proof")
    assert (code, goals["G1"]) == (3, "undeveloped")
    assert "the program is another one than the manifest says" in whys(cart)


def forged(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the manifest of the certificate and seal it again."""
    manifest = json.loads((folder / "proof" / "manifest.json").read_text())
    change(manifest)
    raw = canonical_json(manifest)
    (folder / "proof" / "manifest.json").write_bytes(raw)
    (folder / "proof" / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")


@pytest.mark.parametrize(
    ("claims", "code", "open_"),
    [
        ({"P1c": "assumed"}, 4, {"G1", "G1.1", "G1.1.P1c"}),
        ({"P2b": "undecided"}, 4, {"G4", "G4.1"}),
        ({"P2b": "assumed"}, 4, {"G4", "G4.1"}),
        ({"P3": "refuted", "start": None}, 4, {"G1", "G1.1", "G1.1.P3", "G1.1.start"}),
        ({"failsafe": "proved"}, 3, None),
        ({"DM": "proved", "ttf": "undecided"}, 4, {"G1", "G1.1", "G1.1.ttf"}),
    ],
)
def test_what_a_certificate_does_not_prove_is_not_supported(
    soter: Soter, cart: Path, claims: dict[str, str | None], code: int, open_: set[str] | None
) -> None:
    def change(manifest: dict[str, Any]) -> None:
        of = {**manifest["modules"][0]["claims"], **claims}
        manifest["modules"][0]["claims"] = {n: v for n, v in of.items() if v is not None}
        small_proofs.only_claimed(cart / "proof", manifest)

    forged(cart, change)
    exit_code, goals = assured(soter, "--cert", "proof")
    assert exit_code == code
    if open_ is None:
        open_ = set(goals) - {"G5", "G5.1"}
    assert {g for g, s in goals.items() if s != "supported"} == {*open_, "G5", "G5.1"}


def test_a_certificate_that_changes_while_it_is_checked_supports_nothing(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def changed(*_: object) -> Report:
        forged(cart, lambda m: m.update(soter="0"))
        return Report(ACCEPTED)

    monkeypatch.setattr("soter.api.assurance.certificate_check.recheck", changed)
    code, goals = assured(soter, "--cert", "proof")
    assert (code, set(goals.values())) == (3, {"undeveloped"})
    assert "it was changed while it was checked" in whys(cart)


@pytest.mark.parametrize(("why", "code"), [("", 4), ("SafeCart: SC has a queue", 5)])
def test_a_report_that_confirms_nothing_supports_and_refutes_nothing(
    why: str, code: int, soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sha256 = load(cart / "c.soter").sha256
    assert sha256 is not None
    empty = Report("not re-checked" if why else ACCEPTED, why, program_sha256=sha256)
    monkeypatch.setattr("soter.api.assurance.certificate_check.recheck", lambda *_: empty)
    done = soter("assure", "c.soter", "--cert", "proof", "-o", "out", "--json")
    assert (done.exit, set(done.document["goals"].values())) == (code, {"undeveloped"})
    assert (done.document["refuted"], done.document["not_rechecked"]) == ([], why)
    assert not why or f"was not re-checked: {why}" in whys(cart)


def test_without_the_re_checkers_numbers_there_is_no_case(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.api.rechecking.find_spec", lambda _: None)
    done = soter("assure", "c.soter", "--cert", "proof", "-o", "out", "--json")
    assert (done.exit, done.errors) == (1, ["D007"])
    assert not (cart / "out").exists()


def test_a_compiled_decision_module_that_differs_refutes(
    soter: Soter, cart: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module_report = RecheckedModule("SafeCart", {}, confirmed=[*PROOF, "P2b"], system="Protected")
    module_report.parameters = {"GAIN": "1.0"}
    uncovered = "the code that a decision module is compiled to"
    report = Report(ACCEPTED, modules=[module_report])
    report.program_sha256 = load(cart / "c.soter").sha256 or ""
    report.not_covered = [RecheckAssumption("compiled", uncovered)]
    monkeypatch.setattr("soter.api.assurance.certificate_check.recheck", lambda *_: report)
    assert assured(soter, "--cert", "proof")[0] == 0
    assert "compiled to" not in json.dumps(case_of(cart))
    monkeypatch.setattr("soter.verify.deploy.dm_check.expected_mode", lambda *_, **__: 0)
    code, goals = assured(soter, "--cert", "proof")
    assert [code, *map(goals.get, ("G1", "G6", "G6.1"))] == [3, "supported", *["undeveloped"] * 2]
    assert "the C of the DM differs from the switching logic" in whys(cart)
    contexts = [n["text"] for n in case_of(cart)["nodes"] if n["kind"] == "context"]
    assert f"not covered: {uncovered}" in contexts


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Undriven", "an input keeps its default all the time"),
        ("Rests", "it rests on the contract of Say, of which no test asks"),
    ],
)
def test_a_test_that_is_not_clean_or_rests_on_what_nobody_asks_supports_nothing(
    soter: Soter, cart: Path, name: str, why: str
) -> None:
    (cart / "c.soter").write_text(CONTRACTS)
    _, goals = assured(soter, "--tests")
    case = case_of(cart)
    goal = next(n for n in case["nodes"] if n["text"].startswith(f"test {name} "))
    (leaf,) = goal["supported_by"]
    assert goals[goal["id"]] == "undeveloped"
    assert why in next(n["why"] for n in case["nodes"] if n["id"] == leaf)


@pytest.mark.long
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


def rewritten(path: Path, number: str, column: str, to: str) -> None:
    """Another cell of a flight in `flights.csv`."""
    with path.open(newline="") as file:
        head, *rows = list(csv.reader(file))
    for row in rows:
        if row[head.index("number")] == number:
            row[head.index(column)] = to
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([head, *rows])


def test_flights_that_violate_are_flown_first_andnever_left_out(soter: Soter, cart: Path) -> None:
    run = ("campaign", "c.soter", "--system", "Unprotected", "--flights", "4", "--until", "30s")
    soter(*run, "-o", "fly")
    again = ("--system", "Unprotected", "--campaign", "fly")
    code, goals = assured(soter, *again, "--flights", "1")
    assert (code, goals["G3"]) == (3, "undeveloped"), "AC alone hits the wall"
    flights = cart / "fly" / "flights.csv"
    for number in range(4):
        rewritten(flights, str(number), "violations", "0")
    assert assured(soter, *again)[0] == 3, "what it says is not what was flown"
    assert soter("campaign", "c.soter", "--flights", "4", "--until", "2s", "-o", "calm").exit == 0
    flights = cart / "calm" / "flights.csv"
    rewritten(flights, "2", "violations", "1")
    rewritten(flights, "3", "violations", "1")
    code, goals = assured(soter, "--campaign", "calm", "--flights", "1")
    assert (code, goals["G3"]) == (4, "undeveloped")
    assert "flights that violate a property as recorded were not flown again" in whys(cart)


def test_flights_of_a_system_without_a_property_support_nothing(soter: Soter, here: Path) -> None:
    (here / "c.soter").write_text(
        "soter 1; topic u: int in [0, 9]; node N period 10ms { publishes u; "
        "step { publish u = choose [0, 9]; } } system S { node N; until 1s; "
        "measure idle = 1.0 in [0.0, 1.0] / 2 every 100ms; }"
    )
    soter("campaign", "c.soter", "--flights", "3", "-o", "fly")
    code, goals = assured(soter, "--campaign", "fly")
    assert (code, goals["G3"]) == (4, "undeveloped")
    assert "has no property that a flight could violate" in whys(here)
    about = json.loads((here / "fly" / "campaign.json").read_text())
    for change in ({"until_ns": 0}, {"first_seed": -1}, {"until_ns": None}):
        (here / "fly" / "campaign.json").write_text(json.dumps({**about, **change}))
        done = soter("assure", "c.soter", "--campaign", "fly", "-o", "out", "--json")
        assert done.codes == ["D006"]
    (here / "fly" / "campaign.json").write_text(json.dumps(about))
    rewritten(here / "fly" / "flights.csv", "1", "number", str(10**30))
    assert soter("assure", "c.soter", "--campaign", "fly", "-o", "out", "--json").codes == ["D006"]


def test_what_is_no_evidence_is_told_in_words(soter: Soter, cart: Path) -> None:
    (cart / "tests.json").write_text("[]")
    run = ("assure", "c.soter", "-o", "out", "--json")
    assert soter(*run, "--test-report", "tests.json").errors == ["D005"]
    assert soter(*run, "--test-report", "none.json").errors == ["D006"]
    assert soter(*run, "--campaign", "none").errors == ["D006"]
    assert soter(*run, "--cert", "none").errors == ["D009"]
    (cart / "file").write_text("in the way")
    assert soter("assure", "c.soter", "-o", "file", "--json").errors == ["D006"]


def test_the_hazards_of_the_example_are_traced_and_what_is_open_is_listed(
    soter: Soter, cart: Path
) -> None:
    given = ("--cert", "proof", "--hazards", str(HAZARDS), "-o", "out", "--json")
    done = soter("assure", "c.soter", *given)
    assert (done.exit, done.document["supported"], done.document["covered"]) == (4, True, False)
    case = case_of(cart)
    items = {i["id"]: i["status"] for i in case["traceability"]["items"]}
    supported = dict.fromkeys(("H1", "H2", "R1", "R2"), "supported")
    assert items == {**supported, "H3": "open", "H4": "open"}
    assert case["traceability"]["sha256"] == hashlib.sha256(HAZARDS.read_bytes()).hexdigest()
    open_ = {(o["kind"], o["id"]): o["why"] for o in done.document["open"]}
    assert open_["hazard", "H3"] == "undeveloped: `SafeCart.failsafe`"
    assert open_["hazard", "H4"] == "it leads to no property"
    assumptions = {n["key"]: n for n in case["nodes"] if n["kind"] == "assumption"}
    assert assumptions["world c"]["owner"] == "plant"
    assert open_["assumption", assumptions["world c"]["id"]] == "no evidence"
    unowned = [n for n in assumptions.values() if not n["owner"]]
    assert len(unowned) == len(assumptions) - 5 > 5
    page = (cart / "out" / "index.html").read_text()
    for text in ("H1", "Laser tracker beside the encoder", "The cart strikes an end of the track"):
        assert text in page
    said = soter("assure", "c.soter", "--hazards", str(HAZARDS), "-o", "out").out
    assert "hazard H4: it leads to no property" in said
    assert "5 assumptions (owner, validation, evidence), which the page lists" in said


def test_a_case_without_hazards_lists_every_assumption_as_open(soter: Soter, cart: Path) -> None:
    done = soter("assure", "c.soter", "--cert", "proof", "-o", "out", "--json")
    assert (done.exit, done.document["covered"]) == (0, True)
    assumptions = [n["id"] for n in case_of(cart)["nodes"] if n["kind"] == "assumption"]
    assert [o["id"] for o in done.document["open"] if o["kind"] == "assumption"] == assumptions
    assert "no file of hazards" in soter("assure", "c.soter", "-o", "out").out.lower()


@pytest.mark.usefixtures("unasked")
def test_a_wrong_file_of_hazards_is_told_before_any_check(soter: Soter, cart: Path) -> None:
    run = ("assure", "c.soter", "--cert", "proof", "-o", "out", "--json", "--hazards")
    (cart / "h.csv").write_text("kind,id,text,traces_to\nhazard,H1,x,SafeCart.saf\n")
    done = soter(*run, "h.csv")
    assert (done.exit, done.errors) == (1, ["D021"])
    assert done.document["diagnostics"][-1]["line"] == 2
    assert soter(*run, "none.csv").errors == ["D006"]
    assert not (cart / "out").exists()


def test_an_assumption_that_the_certificate_does_not_rest_on_is_refused(
    soter: Soter, cart: Path
) -> None:
    (cart / "h.csv").write_text("kind,id,owner\nassumption,world d,somebody\n")
    run = ("assure", "c.soter", "-o", "out", "--hazards", "h.csv", "--json")
    done = soter(*run, "--cert", "proof")
    assert (done.exit, done.errors) == (1, ["D021"])
    assert done.document["diagnostics"][-1]["helps"] == ["did you mean `world c`?"]
    assert not (cart / "out").exists()
    assert soter(*run).exit == 4, "without a certificate nobody knows the assumptions"


def test_versions_hashes_and_flags_are_those_of_what_was_used(soter: Soter, cart: Path) -> None:
    assured(soter, "--cert", "proof", "--set", "GAIN=1.0")
    told = case_of(cart)["provenance"]
    seal = (cart / "proof" / "SEAL").read_text().strip()
    assert seal in told["certificate"]
    assert VERSION in told["Soter"]
    assert soter_sha256() in told["Soter"]
    for flag in ("-std=c99", "-ffp-contract=off", "-O2"):
        assert flag in told["C compiler"].split()
    assert compiler_version(find_compiler()) in told["C compiler"]
    foot = (cart / "out" / "index.html").read_text().split('class="foot"')[1]
    for text in (seal, soter_sha256(), rechecker_sha256(), "-ffp-contract=off"):
        assert text in foot


@pytest.mark.long
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
