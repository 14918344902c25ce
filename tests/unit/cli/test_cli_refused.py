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
