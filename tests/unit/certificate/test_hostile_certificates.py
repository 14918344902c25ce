"""Folders that keep a re-checker busy, fill its memory or draw on the terminal: refused."""

from __future__ import annotations

import json
import os
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.reading import folder as certificate_folder
from soter.certificate.reading.folder import (
    BYTES_MAX,
    FILE_MAX,
    FORMAT,
    MANIFEST_MAX,
    PROGRAM_MAX,
    canonical_json,
    read_program,
)
from soter.certificate.rechecker import recheck
from soter.certificate.report import NOT_RECHECKED, REJECTED, RejectedError
from soter.cli.main import main
from unit.certificate import small_proofs
from work import work_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Change = Callable[[Callable[[dict[str, Any]], None]], Path]

CALLS_MAX = 2_000_000
"""Functions called until a certificate is refused: a check of one calls many more."""


def reason_of(folder: Path, verdict: str = NOT_RECHECKED) -> str:
    report, calls = work_of(lambda: recheck(folder))
    assert report.verdict == verdict
    assert calls <= CALLS_MAX
    return report.reason


def sparse(path: Path, size: int) -> None:
    with path.open("wb") as file:
        file.truncate(size)


# ---------------------------------------------------------------- other formats


@pytest.mark.parametrize(
    ("version", "age"), [(FORMAT - 1, "an older"), (FORMAT + 1, "a newer"), (10**9, "a newer")]
)
def test_another_format_is_named_and_not_rejected(
    copied: Path, version: int, age: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever else it holds: nothing of another format is known."""
    manifest = json.loads((copied / "manifest.json").read_text()) | {"schema": version, "new": []}
    (copied / "elsewhere.bin").write_bytes(b"1")
    small_proofs.seal(copied, manifest)
    why = (
        f"its format is {version}, of {age} soter, and this one reads format {FORMAT}: "
        "make it again with `soter verify --cert`"
    )
    assert reason_of(copied) == why
    assert main(["recheck", str(copied)]) == 5
    said = capsys.readouterr().out
    assert said.startswith("NOT RE-CHECKED")
    assert why in said


def test_another_format_with_a_broken_seal_is_rejected(copied: Path) -> None:
    manifest = json.loads((copied / "manifest.json").read_text()) | {"schema": FORMAT - 1}
    (copied / "manifest.json").write_bytes(canonical_json(manifest))
    assert reason_of(copied, REJECTED) == "the seal does not fit the manifest"


# ---------------------------------------------------------------- sizes


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("sets/0_K.bin", 20 << 30),
        ("sets/more.bin", FILE_MAX + 1),
        ("program/cart.soter", PROGRAM_MAX + 1),
        ("manifest.json", MANIFEST_MAX + 1),
        ("SEAL", 20 << 30),
    ],
)
def test_a_huge_file_is_not_read(copied: Path, name: str, size: int) -> None:
    sparse(copied / name, size)
    assert "too many to be read" in reason_of(copied)


def test_many_large_files_are_not_read(copied: Path) -> None:
    for k in range(BYTES_MAX // FILE_MAX + 1):
        sparse(copied / "sets" / f"more{k}.bin", FILE_MAX)
    assert "the files are larger than" in reason_of(copied)


def test_a_file_that_grows_is_noticed(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original_sizes = certificate_folder._file_sizes

    def smaller(folder: Path) -> dict[str, int]:
        return {
            name: size - (name == "sets/0_K.bin") for name, size in original_sizes(folder).items()
        }

    monkeypatch.setattr(certificate_folder, "_file_sizes", smaller)
    assert "was changed while it was read" in reason_of(copied, REJECTED)


@pytest.mark.parametrize("name", ["sets/0_K.bin", "sets/more.bin", "program/cart.soter"])
def test_a_pipe_is_no_file(copied: Path, name: str) -> None:
    (copied / name).unlink(missing_ok=True)
    os.mkfifo(copied / name)
    assert "neither a file nor a folder" in reason_of(copied, REJECTED)


def test_a_link_to_a_folder_is_not_followed(copied: Path) -> None:
    (copied / "sets" / "up").symlink_to(copied)
    assert "neither a file nor a folder" in reason_of(copied, REJECTED)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is refused to root")
def test_a_file_that_the_system_refuses_is_a_reason(copied: Path) -> None:
    (copied / "sets" / "0_K.bin").chmod(0)
    assert "cannot be read" in reason_of(copied)


def test_more_cells_than_are_looked_at(
    copied: Path, changed: Change, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificate_folder, "CELLS_MAX", 100)
    assert "cells in all grids" in reason_of(changed(lambda _: None))
    assert copied.exists()


def test_times_far_beyond_those_of_the_program_are_refused(changed: Change) -> None:
    def longer(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["times"]["H_ns"] = 3_600 * 10**9

    assert "no program needs" in reason_of(changed(longer))


# ---------------------------------------------------------------- files of the program


def test_a_file_that_the_program_does_not_read_is_refused(copied: Path) -> None:
    """Listed and sealed as it is: the help says that an additional file is rejected."""
    manifest = json.loads((copied / "manifest.json").read_text())
    (copied / "program" / "other.soter").write_text("soter 1;\n")
    manifest["files"]["program/other.soter"] = ""
    small_proofs.reseal(copied, manifest)
    reason = reason_of(copied, REJECTED)
    assert reason == "the program does not read `program/other.soter`"


# ---------------------------------------------------------------- what is printed

DRAWN = "\x1b[1A\x1b[2KACCEPTED\r"


@pytest.mark.parametrize("where", ["sets", "program"])
def test_a_name_does_not_draw_on_the_terminal(
    copied: Path, where: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (copied / where / f"{DRAWN}.bin").write_bytes(b"")
    assert main(["recheck", str(copied)]) == 3
    out = capsys.readouterr().out
    assert "REJECTED" in out
    assert "\\x1b[1A" in out
    assert "\x1b" not in out
    assert "\r" not in out


def test_text_of_a_manifest_does_not_draw_on_the_terminal(
    changed: Change, capsys: pytest.CaptureFixture[str]
) -> None:
    def renamed(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["system"] = DRAWN

    folder = str(changed(renamed))
    assert main(["recheck", folder]) == 3
    assert "\x1b" not in capsys.readouterr().out
    assert main(["recheck", folder, "--json"]) == 3
    assert "\\\\x1b[1A" in capsys.readouterr().out


def test_the_name_of_the_folder_does_not_draw_either(
    copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = copied.rename(copied.parent / DRAWN)
    assert main(["recheck", str(folder)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("ACCEPTED")
    assert "\x1b" not in out
    assert "\r" not in out


def test_a_comment_of_the_program_does_not_draw(
    copied: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main_file = copied / "program" / "cart.soter"
    moved = main_file.rename(main_file.with_name("\x1b[2Jcart.soter"))
    manifest = json.loads((copied / "manifest.json").read_text())
    manifest["files"][f"program/{moved.name}"] = manifest["files"].pop("program/cart.soter")
    manifest["main"] = moved.name
    small_proofs.reseal(copied, manifest)
    assert main(["recheck", str(copied)]) in (0, 3)
    assert "\x1b" not in capsys.readouterr().out


def test_a_program_that_changes_between_two_readings_is_refused(
    copied: Path, tmp_path: Path
) -> None:
    """Sealed is one program, checked would be another one, whose hash the manifest says."""
    other = tmp_path / "other"
    shutil.copytree(copied, other)
    changed = small_proofs.edit_program(other, ("soter 1;", "soter 1; // another one"))
    manifest = json.loads((copied / "manifest.json").read_text())
    manifest["program_sha256"] = changed["program_sha256"]
    small_proofs.seal(copied, manifest)
    certificate = certificate_folder.read_certificate(copied)
    main_file = f"program/{manifest['main']}"
    shutil.copy(other / main_file, copied / main_file)
    with pytest.raises(RejectedError, match="changed while it was being read"):
        read_program(certificate)
