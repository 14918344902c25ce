"""`soter recheck`: exits and documents."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from json_documents import problems_of
from soter.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def document(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    assert not problems_of(found)
    return found


def test_accepted_is_0(proved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(proved), "--json"]) == 0
    found = document(capsys)
    assert found["accepted"] is True
    assert found["reason"] == ""
    assert main(["recheck", str(proved)]) == 0
    assert "ACCEPTED" in capsys.readouterr().out


def test_rejected_is_3(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copied / "sets" / "more.bin").write_bytes(b"\0")
    assert main(["recheck", str(copied), "--json"]) == 3
    found = document(capsys)
    assert found["accepted"] is False
    assert "more.bin" in str(found["reason"])
    assert main(["recheck", str(copied)]) == 3
    assert "more.bin" in capsys.readouterr().out


def test_no_certificate_is_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", str(tmp_path), "--json"]) == 1
    assert document(capsys)["diagnostics"][0]["code"] == "D009"  # type: ignore[index]


def test_no_folder_is_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recheck", "--json"]) == 2
    document(capsys)
