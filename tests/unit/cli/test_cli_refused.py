"""Whatever the system refuses to write: a diagnostic in words, which names the file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path

    from .conftest import Soter

QUICK = ("--until", "1s")
TEST = """soter 1;
topic n: int;
node N period 10ms { publishes n; step { publish n = 1; } }
system S { node N; until 100ms; }
test T { system S; horizon 20ms; always n <= 3; }
"""
WRITING = {
    "run --log": ("run", "cart.soter", *QUICK, "--log"),
    "run --report": ("run", "cart.soter", *QUICK, "--report"),
    "verify --report": ("verify", "cart.soter", "--report"),
    "verify --cert": ("verify", "cart.soter", "--cert"),
    "build": ("build", "cart.soter", "-o"),
    "test --junit": ("test", "small.soter", "--junit"),
    "show": ("show", "cart.soter", "-o"),
    "assure": ("assure", "cart.soter", "-o"),
    "campaign": ("campaign", "cart.soter", "--flights", "1", "-o"),
    "new": ("new",),
}


@pytest.mark.parametrize("what", WRITING)
@pytest.mark.parametrize("target", ["/dev/full", "/proc/nowhere"])
def test_what_cannot_be_written_is_named(soter: Soter, here: Path, what: str, target: str) -> None:
    (here / "small.soter").write_text(TEST, encoding="utf-8")
    done = soter(*WRITING[what], target, "--json")
    assert done.exit in (1, 2)
    (told,) = (d for d in done.document["diagnostics"] if d["severity"] == "error")
    assert told["code"] in ("D006", "D008", "D001"), told
    assert target in told["message"]
    assert "Errno" not in told["message"]
    assert not list(here.glob(".soter/crash-*"))


def test_a_figure_does_not_take_the_place_of_a_program(soter: Soter, here: Path) -> None:
    before = (here / "cart.soter").read_bytes()
    assert soter("advise", "cart.soter", "--report", "cart.soter").exit == 1
    assert (here / "cart.soter").read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "cart.soter", "--cert", "fresh", "--report", "fresh/page.html"),
        ("verify", "cart.soter", "--cert", "fresh", "--report", "fresh/figures/page.html"),
        ("verify", "cart.soter", "--report", "proof/page.html"),
        ("run", "cart.soter", "--until", "1s", "--log", "proof/run.mcap"),
        ("advise", "cart.soter", "--report", "proof/sets/figure.html"),
        ("assure", "cart.soter", "--cert", "proof", "-o", "proof"),
        ("assure", "cart.soter", "-o", "proof/case"),
    ],
    ids=" ".join,
)
def test_nothing_is_written_into_a_certificate(
    soter: Soter, here: Path, words: tuple[str, ...]
) -> None:
    """Every byte of one counts: with a file more it is rejected."""
    (here / "proof" / "sets").mkdir(parents=True)
    for name in ("SEAL", "manifest.json"):
        (here / "proof" / name).write_text("{}")
    done = soter(*words)
    assert (done.exit, "a certificate with a file more is rejected" in done.err) == (1, True)
    assert not (here / "fresh").exists()
    assert {p.name for p in (here / "proof").rglob("*")} == {"sets", "SEAL", "manifest.json"}
