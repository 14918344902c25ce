"""`soter verify`, `recheck` and `assure` print one list of assumptions with one numbering."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from soter.certificate import rechecker
from unit.certificate import small_proofs
from unit.cli.test_cli_assure import cart, case_of, proved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

__all__ = ["cart", "proved"]


@pytest.fixture(autouse=True)
def _claims_are_not_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is assumed does not hang on it."""
    monkeypatch.setattr(rechecker, "_check_cases", lambda *_: None)


def numbers_in(out: str) -> dict[str, str]:
    """Number -> text of the assumptions in what a command printed; each number stands once."""
    said = re.findall(r"^  (A\d+) +(.*)$", out, re.MULTILINE)
    assert len({n for n, _ in said}) == len({t for _, t in said}) == len(said) > 10
    return dict(said)


def assumptions_of_case(soter: Soter, folder: Path, cert: str, *more: str) -> list[dict[str, str]]:
    """The assumptions in the case that is made of a certificate."""
    soter("assure", "c.soter", "--cert", cert, *more, "-o", "out")
    return [n for n in case_of(folder)["nodes"] if n["kind"] == "assumption"]


def test_one_list_with_one_numbering(soter: Soter, cart: Path) -> None:
    run = ("verify", "c.soter", "--system", "Protected", "--no-refute", "--cert", "again")
    verified = numbers_in(soter(*run).out)
    rechecked = numbers_in(soter("recheck", "again").out)
    nodes = assumptions_of_case(soter, cart, "again", "--tests")
    case = {n["id"]: n["text"] for n in nodes}
    assert len(case) == len(set(case.values())) == len(nodes)
    assert case.items() >= verified.items() | rechecked.items()
    for n in nodes:
        both = ["verify"] * (n["id"] in verified) + ["recheck"] * (n["id"] in rechecked)
        assert n["stated_by"] == " and ".join(both or ["test"])
    assert {n["key"] for n in nodes if n["stated_by"] == "verify"} == {"age"}
    assert {n["key"] for n in nodes if n["stated_by"] == "recheck"} == {"scheme"}


def test_a_forged_list_changes_nothing_in_a_case_that_the_rechecker_derives(
    soter: Soter, cart: Path
) -> None:
    before = assumptions_of_case(soter, cart, "proof")
    manifest = json.loads((cart / "proof" / "manifest.json").read_text())
    texts = [text for _, text in manifest["assumptions"]]
    forged = ["it holds for every robot", *texts[:0:-1]]
    manifest["assumptions"] = [["world c", text] for text in forged]
    small_proofs.seal(cart / "proof", manifest)
    after = assumptions_of_case(soter, cart, "proof")
    derived = [
        {(n["key"], n["text"]) for n in nodes if "recheck" in n["stated_by"]}
        for nodes in (before, after)
    ]
    assert derived[0] == derived[1]
    assert len(derived[0]) > 10
    assert [n["id"] for n in after if n["text"] == forged[0]] == ["A1"]
    assert next(n["stated_by"] for n in after if n["text"] == forged[0]) == "verify"
