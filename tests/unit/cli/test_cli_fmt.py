"""`soter fmt`: in place, whole or not at all."""

from __future__ import annotations

import io
import stat
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

UGLY = "soter 1;\nconst   A : int=3;\n"
NICE = "soter 1;\nconst A: int = 3;\n"


@pytest.fixture
def ugly(here: Path) -> Path:
    path = here / "ugly.soter"
    path.write_text(UGLY)
    return path


def test_it_rewrites_in_place_and_keeps_the_permissions(soter: Soter, ugly: Path) -> None:
    ugly.chmod(0o640)
    done = soter("fmt", "ugly.soter")
    assert (done.exit, done.out) == (0, "laid out  ugly.soter\n")
    assert ugly.read_text() == NICE
    assert stat.S_IMODE(ugly.stat().st_mode) == 0o640
    assert soter("fmt", "ugly.soter").out == "1 file laid out already\n"


def test_check_changes_nothing(soter: Soter, ugly: Path) -> None:
    done = soter("fmt", "--check", "ugly.soter")
    assert (done.exit, done.out) == (1, "would change  ugly.soter\n")
    assert ugly.read_text() == UGLY
    assert soter("fmt", "--check", "ugly.soter", "--json").document["changed"] == ["ugly.soter"]


def test_diff_changes_nothing(soter: Soter, ugly: Path) -> None:
    done = soter("fmt", "--diff", "ugly.soter")
    assert done.exit == 0
    assert "-const   A : int=3;\n+const A: int = 3;\n" in done.out
    assert ugly.read_text() == UGLY


def test_the_document_has_the_difference_that_was_asked_for(soter: Soter, ugly: Path) -> None:
    shown = soter("fmt", "--diff", "ugly.soter").out
    told = soter("fmt", "--diff", "--json", "ugly.soter").document
    assert (told["diff"], ugly.name in told["diff"]) == (shown.rstrip("\n"), True)
    assert "diff" not in soter("fmt", "--check", "--json", "ugly.soter").document


def test_standard_input(soter: Soter, monkeypatch: pytest.MonkeyPatch) -> None:
    def give(data: bytes) -> None:
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))

    give(UGLY.encode())
    assert soter("fmt", "-").out == NICE
    give(UGLY.encode())
    assert soter("fmt", "-", "--json").document["text"] == NICE
    give(b"soter 1;\nconst\xff")
    assert soter("fmt", "-").exit == 1
    give(b"soter 1; const")
    done = soter("fmt", "-")
    assert (done.exit, done.out) == (1, "")


def test_a_mistake_in_one_file_does_not_keep_the_others(soter: Soter, ugly: Path) -> None:
    (ugly.parent / "wrong.soter").write_text("soter 1;\nconst ;\n")
    done = soter("fmt", "wrong.soter", "ugly.soter", "nowhere.soter")
    assert done.exit == 1
    assert ugly.read_text() == NICE
    assert (ugly.parent / "wrong.soter").read_text() == "soter 1;\nconst ;\n"
    assert "wrong.soter:2" in done.err
    assert "nowhere.soter" in done.err
