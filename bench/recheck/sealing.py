"""Certificates in memory: sealed as right ones are, with figures that fit their program.

Purpose: `read`, `seal`, `fit`. Non-goals: what is wrong with them.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.folder import canonical_json

if TYPE_CHECKING:
    from pathlib import Path

Manifest = dict[str, Any]
Contents = dict[str, bytes]


def read(folder: Path) -> tuple[Manifest, Contents]:
    """The manifest of a certificate, and its other files by their names."""
    manifest = json.loads((folder / "manifest.json").read_text())
    return manifest, {name: (folder / name).read_bytes() for name in manifest["files"]}


def seal(folder: Path, manifest: Manifest, contents: Contents) -> None:
    """Every file is written and every hash is right."""
    write(folder, contents)
    manifest["files"] = {n: hashlib.sha256(d).hexdigest() for n, d in contents.items()}
    raw = canonical_json(manifest)
    (folder / "manifest.json").write_bytes(raw)
    (folder / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")


def write(folder: Path, contents: Contents) -> None:
    """The files of a certificate without its manifest."""
    for name, data in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def fit(entry: Manifest, facts: Any) -> None:  # noqa: ANN401 - of the re-checker
    """Times and inputs of a module's entry as its program has them."""
    entry["times"].update({k: facts.times[k] for k in entry["times"]})
    inputs = entry["inputs"][: len(facts.states)]
    for i, extent in facts.axes.items():
        if extent is not None and i < len(inputs):
            inputs[i] |= {"low": extent[0].hex(), "high": extent[1].hex()}
    others = [*facts.controls, *facts.disturbances, *facts.errors, *facts.others]
    entry["inputs"] = inputs + [
        {"name": x.name, "kind": x.kind, "low": x.low.hex(), "high": x.high.hex()} for x in others
    ]
