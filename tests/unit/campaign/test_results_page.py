"""docs/results.md: which sentence is said depends on what was flown."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from bench.running import results_page as results

from soter import load

if TYPE_CHECKING:
    from soter.campaign.result import Campaign

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
INSIDE, OUTSIDE = (
    "stuck SafeCart.Fast at 400 per 1h for 1s",
    "late SafeCart.dm by 900ms at 900 per 1h",
)


def campaign(folder: Path, faults: str) -> Campaign:
    head, tail = CART.read_text(encoding="utf-8").split("system Protected", 1)
    said = f"until 30s;\n  faults {{ {faults} }}" if faults else "until 30s;"
    path = folder / "cart.soter"
    path.write_text(f"{head}system Protected{tail.replace('until 30s;', said, 1)}")
    return load(path).campaign("Protected", flights=30, until="20s", output=folder / "c")


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ("", "Nothing was declared to go wrong"),
        (f"{INSIDE};", "1 faults were declared, all of them inside"),
        (f"{INSIDE}; {OUTSIDE};", "1 of them inside of what the proofs assume and 1 outside:"),
    ],
)
def test_faults_are_called_inside_where_all_of_them_are(
    faults: str,
    said: str,
    tmp_path: Path,
) -> None:
    cart_campaign = campaign(tmp_path, faults)
    assert said in results.declared(cart_campaign)
    assert ("all of them" in results.declared(cart_campaign)) == (faults == f"{INSIDE};")
    outside = [row for row in results.table(cart_campaign) if "outside" in row]
    assert len(outside) == (OUTSIDE in faults)


def test_what_is_said_of_violations_is_what_was_flown(tmp_path: Path) -> None:
    cart_campaign = campaign(tmp_path, f"{OUTSIDE};")
    flat = load(tmp_path / "cart.soter").flat("Protected")
    text, r = results.judged(cart_campaign, flat), cart_campaign.result
    assert r.violations > 0
    assert f"{r.violations} violations in" in text
    assert f"{r.flights_violated} of them are clean when they are flown again" in text
    assert "`always Clear(c.truth)`" in text
    assert results.broken(cart_campaign)[2] == f"| {r.violations} | `always Clear(c.truth)` |"


def test_flights_that_are_others_when_run_again_are_told() -> None:
    assert "all to the digest" in results.introduction([True, True])
    assert "1 of them NOT to the digest" in results.introduction([True, False])


def test_the_page_calls_inside_what_its_own_tables_do() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    sections = re.split(r"^###? ", page, flags=re.MULTILINE)
    said = [s for s in sections if "faults were declared" in s]
    assert len(said) == 2
    for section in said:
        outside = re.findall(r"\| outside( \||$)", section)
        assert ("all of them inside" in section) == (not outside)
    assert len(re.findall(r"all of them inside", page)) == 1


def test_the_title_has_our_figures_beside_the_papers() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    rows = [re.split(r" *\| *", line)[1:-1] for line in page.splitlines() if line.startswith("|")]
    ours, paper = page.splitlines()[0].split("; the paper: ")
    told = {row[0]: row[1:] for row in rows if len(row) == 4}
    for column in (1, 2):
        assert f"{told['violations'][column].split()[0]} " in ours
        hours = re.search(r", ([\d.]+) h of it aloft", told["simulated"][column])
        assert hours is not None
        assert f"{float(hours[1]):.0f}" in ours
        assert told["flown"][column].split(" km")[0] in ours
    assert told["violations"][0] in paper
    assert told["simulated"][0].split()[0] in paper
    assert told["flown"][0].removeprefix("about ") in paper
    figures = results.title(result(0, 172.8, 1564.2), result(3, 170.4, 1500.0))
    assert "0 and 3 violations in 173 and 170 h aloft and 1,564 and 1,500 km of two" in figures
    assert page.startswith(f"# {results.title(result(0, 172.8, 1564.2), result(0, 173.1, 1563.8))}")


@pytest.mark.parametrize(("crashed", "said"), [(0, "none of 60"), (3, "3 of 60")])
def test_the_simulators_are_not_compared(
    crashed: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    papers = SimpleNamespace(name="paper", result=SimpleNamespace(flights=60))
    monkeypatch.setattr(results, "crashes", lambda _: crashed)
    told = results.simulators(SimpleNamespace(arms=[papers]))  # type: ignore[arg-type]
    assert f"{said} flights crashed in ours" in told
    assert "arm" not in results.simulators(SimpleNamespace(arms=[]))  # type: ignore[arg-type]
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| paper | "))
    assert ("\n".join(results.prose(told)) in page) is (
        row.split(" | ")[1:3] == ["60", f"{crashed}"]
    )


def test_the_flights_on_firmware_are_those_of_the_benchmarks() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert page.endswith("\n".join(["", *results.on_firmware()]) + "\n")


def result(violations: int, hours: float, km: float) -> Any:
    """As much of a result as the title says."""
    return SimpleNamespace(violations=violations, rate_hours=hours, km=km)
