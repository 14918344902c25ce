"""A folder that somebody sent leads elsewhere: of what lies there nothing is written over.

Purpose: links in the places whose names Soter chooses, in each folder that it fills: the one of
its own (`.soter`), of campaigns, packages, safety cases; and beside files. A link that
a person names is followed, as any program does.
"""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest
from bench.hostile.bad_input_samples import VIOLATED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

KEPT = b"mine\n"
FLY = "campaign cart.soter --flights 1 --until 20ms -o out"
CASES = {
    ".soter/cart-times.json": "measure cart.soter --samples 2 --until 20ms",
    ".soter/violated-T.trace.json": "test violated.soter --test T",
    ".soter/cart.svg/x": "check cart.soter",
    ".soter": "test violated.soter --test T",
    "out/campaign.lock": FLY,
    "out/campaign.json": FLY,
    "out/campaign.part": FLY,
    "out/flights.csv": FLY,
    "out/report.html": f"{FLY} --report",
    "out/cart.c": "build cart.soter -o out",
    "out/.soter-files.json": "build cart.soter -o out",
    "out/case.json": "assure violated.soter -o out",
    "out/violated-T.trace.json": "test violated.soter --test T -o out",
    "out-lateness.json": f"{FLY} --arms paper",
}
"""A place whose name Soter chooses, and the command that writes there."""


@pytest.fixture
def outside(here: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    (here / "violated.soter").write_text(VIOLATED)
    folder = tmp_path_factory.mktemp("outside")
    (folder / "there").write_bytes(KEPT)
    signal.alarm(60)
    yield folder
    signal.alarm(0)


@pytest.mark.skipif(os.name != "posix", reason="of links")
@pytest.mark.parametrize(
    "target", ["there", *(pytest.param(x, marks=pytest.mark.long) for x in ("not there", "."))]
)
@pytest.mark.parametrize("place", CASES)
def test_no_link_leads_out_of_a_folder_that_soter_fills(
    here: Path, outside: Path, soter: Soter, place: str, target: str
) -> None:
    """A link to a file, to nothing (which would be made), to a folder (in which it would be)."""
    link = here / place
    if CASES[place].startswith(FLY) and link.parent != here:  # a campaign that goes on there
        assert soter(*CASES[place].split()).exit == 0
        link.unlink(missing_ok=True)
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(outside / target)
    done = soter(*CASES[place].split())
    assert {p.name: p.read_bytes() for p in outside.rglob("*")} == {"there": KEPT}
    assert done.exit in (0, 1, 3, 4), done.err
    assert "I001" not in done.err


def test_a_link_that_is_named_is_followed(here: Path, outside: Path, soter: Soter) -> None:
    (here / "latest.svg").symlink_to(outside / "picture.svg")
    assert soter("show", "cart.soter", "-o", "latest.svg").exit == 0
    assert (outside / "picture.svg").is_file()
    (here / "last").symlink_to(outside)
    assert soter("test", "violated.soter", "--test", "T", "-o", "last").exit == 3
    assert (outside / "violated-T.trace.json").is_file()


def test_a_pipe_where_a_controller_is_written_is_not_waited_for(
    here: Path, outside: Path, soter: Soter
) -> None:
    os.mkfifo(here / "cart_sc.soter")
    done = soter("verify", "cart.soter", "--synthesize")
    assert done.exit == 1
    assert outside.exists()
