"""`soter check` of several programs, and of standard input; `fmt` of what is read-only."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from json_documents import SCHEMAS, _check

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    import pytest

    Soter = Callable[..., Any]

BAD = "soter 1;\nconst A: int = true;\n"
LONE = "soter 1;\nconst   A : int=3;\n"


def given(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text.encode())))


def test_mistakes_in_one_program_do_not_keep_the_others_from_it(soter: Soter, here: Path) -> None:
    (here / "bad.soter").write_text(BAD)
    done = soter("check", "bad.soter", "none.soter", "cart.soter")
    assert done.exit == 1
    assert "bad.soter:2" in done.err
    assert "cannot find `none.soter`" in done.err
    assert done.out.startswith("ok  cart.soter")


def test_several_programs_in_one_document(soter: Soter, here: Path) -> None:
    (here / "bad.soter").write_text(BAD)
    document = soter("check", "cart.soter", "bad.soter", "--json").document
    assert document["exit"] == 1
    assert [(f["file"], f["exit"]) for f in document["files"]] == [
        ("cart.soter", 0),
        ("bad.soter", 1),
    ]
    assert list(_check(SCHEMAS["check.json"], document["files"][0], "")) == []
    assert {d["file"] for d in document["diagnostics"]} == {"bad.soter"}


def test_all_fine_is_exit_0(soter: Soter) -> None:
    assert soter("check", "cart.soter", "cart.soter").exit == 0


def test_an_unknown_parameter_is_told_of_every_program(soter: Soter) -> None:
    done = soter("check", "cart.soter", "./cart.soter", "--set", "NOBODY=1", "--json")
    assert done.exit == 2
    assert [f["exit"] for f in done.document["files"]] == [2, 2]


def test_a_program_on_standard_input(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given(monkeypatch, (here / "cart.soter").read_text())
    done = soter("check", "-", "--json")
    assert done.exit == 0
    named = soter("check", "cart.soter", "--json").document
    assert done.document == {**named, "file": "<stdin>"}
    given(monkeypatch, BAD)
    done = soter("check", "-")
    assert done.exit == 1
    assert "<stdin>:2" in done.err


def test_what_it_imports_is_in_the_current_folder(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "parts.soter").write_text("soter 1;\nconst B: int = 3;\n")
    given(monkeypatch, 'soter 1;\nimport "parts.soter" as parts;\nconst A: int = parts.B;\n')
    assert soter("check", "-").exit == 0
    given(monkeypatch, 'soter 1;\nimport "others.soter" as parts;\nconst A: int = parts.B;\n')
    assert "D001" in soter("check", "-").err


def test_what_is_no_text_on_standard_input(soter: Soter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"soter 1;\xff")))
    assert soter("check", "-", "--json").codes == ["D005"]
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b" " * (4 << 20) + b"  ")))
    assert "larger than 4 MiB" in soter("check", "-").err


def test_fmt_does_not_write_what_is_read_only(soter: Soter, here: Path) -> None:
    path = here / "mine here.soter"
    path.write_text(LONE)
    path.chmod(0o444)
    done = soter("fmt", "mine here.soter")
    assert done.exit == 1
    assert "cannot write `mine here.soter`: it is read-only" in done.err
    assert "chmod u+w 'mine here.soter' && soter fmt 'mine here.soter'" in done.err
    assert path.read_text() == LONE
    path.chmod(0o644)
    assert soter("fmt", "mine here.soter").exit == 0
    path.chmod(0o444)
    assert soter("fmt", "mine here.soter").exit == 0, "nothing is to be written"
