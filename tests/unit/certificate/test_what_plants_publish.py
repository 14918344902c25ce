"""Values that a plant cannot publish, axes that no topic shows, schemes, late releases, values set.

Certificates of small programs, as `soter verify` writes them and with more claimed.
"""

from __future__ import annotations

import json
import math
import random
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from bench.recheck.small_modules import PROGRAMS

import soter
from long_tests import some
from soter.certificate.rechecker import recheck
from soter.certificate.terms.linear_enclosures import greatest_below
from soter.cli.main import main
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.certificate.report import Report

WRITTEN, COMPUTED = PROGRAMS["written"], PROGRAMS["computed"]
BOUND = ("topic x: float max_age", "topic x: float in [{}, {}] max_age")


def changed(*pairs: tuple[str, str], text: str = WRITTEN) -> str:
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def certificate(folder: Path, text: str, **params: float) -> Path:
    (folder / "small.soter").write_text(text)
    soter.load(folder / "small.soter").verify(cert=folder / "cert", refute=False, params=params)
    return folder / "cert"


def claiming(cert: Path, **claims: str) -> Report:
    """What becomes of it where more is said to be proved."""
    manifest: dict[str, Any] = json.loads((cert / "manifest.json").read_text())
    for entry in manifest["modules"]:
        entry["claims"].update(claims)
    small_proofs.seal(cert, manifest)
    return recheck(cert)


# ---------------------------------------------------------------- declared sets

WIDE = (BOUND[0], BOUND[1].format(-50.0, 50.0))
DIAL = "topic dial: float in [{}, {}];\ntopic u:"


def narrower(cert: Path, old: str, new: str) -> Report:
    """What becomes of it where its program declares another set, and K stays as it was."""
    small_proofs.edit_program(cert, (old, new))
    return recheck(cert)


def dialled(value: str) -> str:
    """A dial that nobody reads, of a wide set."""
    drives = ("drives x = p;", f"drives x = p;\n  drives dial = {value};")
    return changed(("topic u:", DIAL.format(-50.0, 50.0)), drives)


@pytest.mark.parametrize(
    ("low", "high", "right"),
    some([(-0.92, 0.92, True), (-0.92, 0.91, False), (-5.0, 5.0, True), (-0.5, 0.5, False)], 2),
)
def test_k_holds_only_states_that_can_be_published(
    low: float, high: float, right: bool, tmp_path: Path
) -> None:
    """K ends at 0.9, and the error is 0.02."""
    cert = certificate(tmp_path, changed(WIDE))
    report = narrower(cert, WIDE[1], BOUND[1].format(low, high))
    assert report.accepted == right, report.reason
    if right:
        assert "set x" in {s.key for s in report.modules[0].shown}
        assert "set x" not in {s.key for s in report.all_assumptions}
    else:
        assert "`x`" in report.reason


@pytest.mark.parametrize(("bound", "right"), some([(5.0, False), (9.5, True), (50.0, True)], 2))
def test_what_nobody_reads_is_published_all_the_same(
    bound: float, right: bool, tmp_path: Path
) -> None:
    cert = certificate(tmp_path, dialled("10.0 * p"))
    report = narrower(cert, DIAL.format(-50.0, 50.0), DIAL.format(-bound, bound))
    assert report.accepted == right, report.reason
    assert right or "`dial`" in report.reason


@pytest.mark.parametrize(("bound", "right"), [(1.0, False), (50.0, True)])
def test_an_abstraction_that_stops_says_nothing_of_the_vehicle(
    bound: float, right: bool, tmp_path: Path
) -> None:
    """Though no plant that flies publishes on `dial`."""
    drives = ("drives x = p;", "drives x = p;\n  drives dial = 10.0 * p;")
    text = changed(("topic u:", DIAL.format(-50.0, 50.0)), drives, text=PROGRAMS["flying"])
    cert = certificate(tmp_path, text)
    report = narrower(cert, DIAL.format(-50.0, 50.0), DIAL.format(-bound, bound))
    assert report.accepted == right, report.reason
    assert right or "`dial`" in report.reason


@pytest.mark.parametrize(
    ("value", "right"),
    [("p * p", True), ("10.0 * abs(p)", True), ("abs(p) * (p * p)", True), ("abs(p) * p", False)],
)
def test_what_is_never_negative_is_published_from_0_on(
    value: str, right: bool, tmp_path: Path
) -> None:
    """Rounding takes nothing that is not negative below 0."""
    cert = certificate(tmp_path, dialled(value))
    report = narrower(cert, DIAL.format(-50.0, 50.0), DIAL.format(0.0, 50.0))
    assert report.accepted == right, report.reason
    assert right or "`dial`" in report.reason


def test_the_greatest_value_whose_sum_does_not_exceed_a_bound() -> None:
    dice = random.Random(1)  # noqa: S311 - no secret
    for _ in range(2000):
        bound = dice.uniform(-3, 3) * 10.0 ** dice.randint(-6, 6)
        added = dice.choice([0.0, dice.uniform(0, 1) * 10.0 ** dice.randint(-8, 3)])
        greatest = greatest_below(bound, added)
        assert greatest + added <= bound < math.nextafter(greatest, math.inf) + added


@pytest.mark.parametrize("bounds", ["[-1.0, 1.0]", ""])
def test_a_plant_that_no_proof_is_about_is_not_covered(bounds: str, tmp_path: Path) -> None:
    """It stops where 2 u is beyond 1: both tools say that nothing is claimed of it."""
    declared = f"topic q: float{' in ' * bool(bounds)}{bounds} = 0.0;\n"
    q = "plant Q period 10ms { reads u; drives q = 2.0 * u; state s: float; der s = 0.0; }\n"
    beside = ("p: P; module M;", "p: P; other: Q; module M;")
    text = changed(("plant P", declared + q + "plant P"), beside)
    (tmp_path / "small.soter").write_text(text)
    program = soter.load(tmp_path / "small.soter")
    proof = program.verify(cert=tmp_path / "cert", refute=False)
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
    assert (program.simulate(seed=1).violations > 0) == bool(bounds)
    told = [any("plant other" in x for x in proof.coverage.rest)]
    told.append(any("plant other" in said.text for said in report.not_covered))
    assert told == [bool(bounds)] * 2
    assert not any("plant p " in said.text for said in report.not_covered)


# ---------------------------------------------------------------- an axis that no topic shows

LOAD = (
    ("  state p:", "  state load: float in [0.0, 1.0];\n  state p:"),
    ("der p = u + w", "der p = u / (1.0 + 0.1 * load) + w"),
    (" / 80;", " / 80;\n    grid p.load in [0.0, 1.0] / 1;"),
)


def test_an_axis_of_one_cell_that_no_topic_shows_is_accepted(tmp_path: Path) -> None:
    cert = certificate(tmp_path, changed(*LOAD, text=COMPUTED))
    assert json.loads((cert / "manifest.json").read_text())["modules"][0]["tables"][1]["axes"] == []
    report = recheck(cert)
    assert report.accepted, report.reason


def test_the_example_of_the_language_reference_names_such_an_axis() -> None:
    page = (Path(__file__).parents[3] / "docs" / "evidence.md").read_text()
    assert "grid c.load in [0.0, 1.0] / 1;" in page


def forged_table(entry: dict[str, Any]) -> None:
    entry["tables"][0]["axes"] = []


def forged_axis(entry: dict[str, Any]) -> None:
    group = entry["cases"][0]["groups"][1]
    entry["tables"][1]["axes"] = group["axes"]


@pytest.mark.parametrize("how", some([forged_axis, forged_table], 1))
def test_a_table_looks_at_what_topics_show_and_nothing_else(
    how: Callable[[dict[str, Any]], None], tmp_path: Path
) -> None:
    cert = certificate(tmp_path, changed(*LOAD, text=COMPUTED))
    manifest = json.loads((cert / "manifest.json").read_text())
    how(manifest["modules"][0])
    small_proofs.seal(cert, manifest)
    assert "other axes" in recheck(cert).reason


# ---------------------------------------------------------------- schemes

BESIDE = (
    ("  state p:", "  state z: float in [-0.1, 0.1];\n  state p:"),
    (" / 50;", " / 50;\n    grid p.z in [-1.0, 1.0] / 4;"),
)
PENDULUM = (
    ("  state p:", "  state y: float in [-0.1, 0.1];\n  state p:"),
    ("  der p", "  der y = -sin(y);\n  der p"),
    (" / 50;", " / 50;\n    grid p.y in [-1.0, 1.0] / 4;"),
)


@pytest.mark.parametrize(
    ("rate", "more", "right"),
    some(
        [
            ("-1000.0 * z", PENDULUM, False),
            ("-1000.0 * z", (), False),
            ("-2.0 * z", (), True),
            ("-2.0 * z", PENDULUM, True),
        ],
        1,
    ),
)
def test_a_scheme_that_diverges_is_no_proof(
    rate: str, more: tuple[tuple[str, str], ...], right: bool, tmp_path: Path
) -> None:
    """Also beside states whose flow is not linear, which it does not know."""
    text = changed(*BESIDE, ("  der p", f"  der z = {rate};\n  der p"), *more)
    report = recheck(certificate(tmp_path, text))
    assert (report.accepted and report.safe) == right, report.reason


# ---------------------------------------------------------------- late releases


def late(jitter: str) -> str:
    """SC says how late it is released, and nobody how long a step takes; 1 ms is declared."""
    return re.sub(r"(node Slow period 50ms \{)", rf"\1\n  jitter {jitter};", WRITTEN)


@pytest.mark.parametrize(("jitter", "right"), [("1ms", True), ("5ms", False)])
def test_jitter_without_execution_times_counts(jitter: str, right: bool, tmp_path: Path) -> None:
    try:
        cert = certificate(tmp_path, late(jitter))
    except soter.SoterError:  # the prover sees it, too
        assert not right
        return
    report = recheck(cert)
    assert report.accepted == right, report.reason
    assert right or "5 ms after a release" in report.reason


# ---------------------------------------------------------------- values that a system sets

SETS = changed(("system S default { p: P;", "system S default { set GAIN = 3.0; p: P;"))


def test_other_values_than_a_system_sets_are_no_proof_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cert = certificate(tmp_path, SETS)
    assert main(["recheck", str(cert)]) == 0
    assert "GAIN = 3.0\n" in capsys.readouterr().out
    manifest = json.loads((cert / "manifest.json").read_text())
    manifest["params"]["GAIN"] = (2.0).hex()
    small_proofs.seal(cert, manifest)
    code = main(["recheck", str(cert)])
    out = capsys.readouterr().out
    assert code == 3 or (code == 4 and "GAIN = 2.0 (3.0 by the program)" in out)
    del manifest["params"]["GAIN"]
    small_proofs.seal(cert, manifest)
    assert main(["recheck", str(cert)]) == 0
    assert "GAIN = 3.0\n" in capsys.readouterr().out


def test_other_values_than_defaults_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cert = certificate(tmp_path, WRITTEN, GAIN=3.0)
    assert main(["recheck", str(cert)]) == 0
    assert "GAIN = 3.0 (2.0 by the program)" in capsys.readouterr().out


def test_systems_that_set_different_values_are_each_checked_with_their_own(tmp_path: Path) -> None:
    first = "system S default { set GAIN = 3.0; p: P; module M; until 10s; }\n"
    second = "system T { set GAIN = 4.0; p: P; module N; until 10s; }\n"
    module = WRITTEN[WRITTEN.index("rta M") : WRITTEN.index("system S")]
    text = WRITTEN.replace("system S default { p: P; module M; until 10s; }\n", "")
    text += module.replace("rta M", "rta N") + first + second
    report = recheck(certificate(tmp_path, text))
    assert report.accepted, report.reason
    assert [(m.name, m.parameters["GAIN"]) for m in report.modules] == [("M", "3.0"), ("N", "4.0")]
