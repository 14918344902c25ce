"""A certificate made by hand for a plant whose rate jumps: is it accepted where it is true?"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

import soter
from soter.certificate.reading.folder import canonical_json

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
topic pos: float max_age 200ms;
topic cmd: float in [-1.0, 1.0] = 0.0;
plant Cart period 100ms {
  reads cmd;
  drives pos = x;
  state x: float = 5.0;
  der x = RATE;
}
node Ahead period 100ms { publishes cmd; step { publish cmd = 1.0; } }
node Back period 100ms { subscribes pos; publishes cmd; step { publish cmd = -1.0; } }
rta Stay {
  ac Ahead; sc Back; period 100ms; safe pos >= 0.0; ttf pos < -1.0; safer pos >= 0.0;
  verify { grid pos in [0.0, 10.0] / 100; recover never; }
}
system Main default { c: Cart; module Stay; until 20s; }
"""
BACK = "0.5 * cmd - 0.5"
RATES = [
    (f"x > 0.0 ? {BACK} : 0.0", True),
    (f"x == 0.0 ? 1.0 : {BACK}", False),
    (f"(1.0 - abs(sign(x))) + {BACK}", False),
    ("float(floor(x)) + float(floor(-x)) + 0.0 * cmd", False),
]
"""Of each whether the cart stays at 0: all but the first only have another speed exactly there."""


def forged(folder: Path, rate: str) -> Path:
    """A sealed certificate in which all of [0, 10] is K and R."""
    path, sealed = folder / "cart.soter", folder / "proof"
    path.write_text(PROGRAM.replace("RATE", rate))
    soter.load(path).verify(cert=sealed, refute=False)
    manifest = json.loads((sealed / "manifest.json").read_text())
    (sealed / "sets").mkdir(exist_ok=True)
    for old in (sealed / "sets").iterdir():
        old.unlink()
    data = {
        "sets/e": np.linspace(0.0, 10.0, 101).astype("<f8").tobytes(),
        "sets/K": b"\x01" * 100,
        "sets/R": np.packbits(np.ones(100, bool), bitorder="little").tobytes(),
    }
    for name, content in data.items():
        (sealed / name).write_bytes(content)
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in data.items()}
    kept = {n: h for n, h in manifest["files"].items() if n.startswith("program/")}
    manifest["files"] = kept | hashes
    (entry,) = manifest["modules"]
    entry.pop("tables", None)
    claimed = dict.fromkeys(("P2a", "P3", "ttf", "safer", "start"), "proved")
    entry["claims"] |= claimed | {"P1c": "assumed"}
    entry["recover_ns"] = None
    axes = [{"state": "c.x", "edges": "sets/e"}]
    group = {"kind": "grid", "axes": axes, "K": "sets/K", "R": "sets/R"}
    entry["cases"] = [{"parameter": [], "groups": [group]}]
    for x in entry["inputs"]:
        if x["kind"] == "state":
            x["low"], x["high"] = (0.0).hex(), (10.0).hex()
    raw = canonical_json(manifest)
    (sealed / "manifest.json").write_bytes(raw)
    (sealed / "SEAL").write_text(hashlib.sha256(raw).hexdigest() + "\n")
    return sealed


@pytest.mark.parametrize(("rate", "stays"), RATES)
def test_a_wall_is_no_wall_by_what_a_rate_is_at_one_point(
    tmp_path: Path, rate: str, stays: bool
) -> None:
    assert soter.recheck(forged(tmp_path, rate)).accepted is stays


@pytest.mark.parametrize(("rate", "stays"), RATES)
def test_the_prover_proves_no_such_wall(tmp_path: Path, rate: str, stays: bool) -> None:
    """Where SC reads nothing, too: then nothing that is old makes the prover look beyond an end."""
    text = PROGRAM.replace("RATE", rate).replace("subscribes pos; ", "", 2)
    text = text.replace(" ttf pos < -1.0; safer pos >= 0.0;", "")
    (tmp_path / "cart.soter").write_text(text)
    (module,) = soter.load(tmp_path / "cart.soter").verify(refute=False).modules
    assert (module.verdict == "proved") is stays
