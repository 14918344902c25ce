"""A certificate of a module with `rest`, as `soter verify` writes and `soter recheck` reads it."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from json_documents import problems_of
from soter.certificate.reading.folder import canonical_json
from soter.cli.main import main
from unit.certificate.tubes.rest_entries import entry, flat_of
from unit.certificate.tubes.test_forged_rest import PLAIN

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def ranges(given: dict[str, list[str]]) -> dict[str, Any]:
    return {n: [float.fromhex(x) for x in ends] for n, ends in given.items()}


def test_it_is_accepted_and_decided_in_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "follow.soter").write_text(PLAIN, encoding="utf-8")
    folder = tmp_path / "cert"
    assert main(["verify", str(tmp_path / "follow.soter"), "--cert", str(folder)]) == 0
    headline = next(x for x in capsys.readouterr().out.splitlines() if x.startswith("Follow "))
    assert "decided in flight" in headline
    assert "not re-checked" not in headline
    assert main(["recheck", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert not problems_of(document)
    assert (document["accepted"], document["safe"], document["returns"]) == (True, False, False)
    module = document["modules"]["Follow"]
    assert module["in_flight"]
    assert module["missing"] == ["P3", "ttf", "safer"]
    assert main(["recheck", str(folder)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("ACCEPTED, decided in flight")
    assert "asks single verdicts" in out
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    (made,) = manifest["modules"]
    rest = made["rest"]
    assert made == entry(flat_of(PLAIN), ranges(rest["box"]), ranges(rest["ways"]))
    made["claims"]["start"] = "undecided"  # what is claimed holds, and it is less
    resealed(folder, manifest)
    assert main(["recheck", str(folder)]) == 4
    assert "safety is not established (P3, ttf, safer, start" in capsys.readouterr().out
    rest["switches"] += 1
    resealed(folder, manifest)
    assert main(["recheck", str(folder)]) == 3
    assert "switches is 101 in the manifest, 100 by the program" in capsys.readouterr().out
    del made["rest"]
    resealed(folder, manifest)
    assert main(["recheck", str(folder)]) in (3, 5)


def resealed(folder: Path, manifest: dict[str, Any]) -> None:
    raw = canonical_json(manifest)
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n", encoding="utf-8")
