"""What Soter makes of a dozen examples, as hashes: their C, their traces, the verdicts of proofs.

Purpose: two lines of docs/benchmarks/line.jsonl show which outputs a change made other ones. C is
what `soter build --target c` writes of every system, without the runtime; a trace is the hash of
`soter run` of seed 1 that the document has; verdicts are those of every property of every module.
Non-goals: whether any of them is right.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = (
    "wall/cart.soter",
    "wall/brake.soter",
    "wall/shuttle.soter",
    "wall/stop.soter",
    "mountain_car/cliff.soter",
    "testing/planner.soter",
    "testing/two_modules.soter",
    "generality/two_tanks.soter",
    "generality/altitude.soter",
    "rest/cruise.soter",
    "fleet/robot.soter",
    "gallery/token_ring.soter",
)
UNTIL = "5s"
GENERATED = ("soter_app.c", "soter_app.h")
"""Of the files `soter*` of a package; all others are the runtime."""
BESIDE = ("main.c", "Makefile", "README.md", ".soter-files.json")
"""The driver, and what lists the files."""


def soter(folder: Path, *words: str) -> Any:  # noqa: ANN401 - a document of JSON
    """The document of a command, with its exit code as `exit`; all are compiled anew below it."""
    done = subprocess.run(
        (sys.executable, "-m", "soter", *words, "--json"),
        cwd=folder,
        env={**os.environ, "SOTER_CACHE": str(folder / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    told = json.loads(done.stdout) if done.stdout.startswith("{") else {}
    return {**told, "exit": done.returncode}


def generated(folder: Path) -> bytes:
    """All files below a folder that are not the runtime, with their names."""
    written = b""
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        runtime = path.name.startswith("soter") and path.name not in GENERATED
        if not runtime and path.name not in BESIDE:
            written += f"{path.relative_to(folder)}\0".encode() + path.read_bytes()
    return written


def hashed(what: object) -> str:
    """Sixteen digits."""
    return hashlib.sha256(repr(what).encode()).hexdigest()[:16]


def hashes_of(name: str, folder: Path) -> dict[str, str]:
    """Of the systems of one example, in `folder`, where cache and packages are put."""
    path = str(ROOT / "examples" / name)
    texts, traces = [], []
    for system in soter(folder, "check", path)["systems"]:
        out = folder / name.replace("/", "_") / system["name"]
        which = (path, "--system", system["name"])
        built = soter(folder, "build", *which, "--target", "c", "-o", str(out))
        texts.append((system["name"], built["exit"], generated(out)))
        ran = soter(folder, "run", *which, "--until", UNTIL, "--seed", "1")
        traces.append((system["name"], ran["exit"], ran.get("trace_sha256")))
    modules = soter(folder, "verify", path, "--no-refute").get("modules", {})
    verdicts = [
        (module, claim, said["verdict"])
        for module, found in modules.items()
        for claim, said in found["properties"].items()
    ]
    return {"c": hashed(texts), "trace": hashed(traces), "verdicts": hashed(verdicts)}
