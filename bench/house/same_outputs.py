"""Whether two checkouts of Soter make the same of every example: C, traces, verdicts, certificates.

    .venv/bin/python bench/house/same_outputs.py --before ../older_checkout [--until 5s]

Purpose: what a change of the house may not change. Of every system of every example that both have:
the files that `soter build --target c` writes (the runtime aside), the hash of the trace of seed 1;
of the programs in `PROVED`: every verdict, and the files of the certificate (the texts of its
assumptions aside, and its manifest's hash with them). Exit code 1 where something differs.
Non-goals: whether either is right.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PROVED = (
    "wall/cart.soter",
    "wall/brake.soter",
    "wall/lift.soter",
    "wall/shuttle.soter",
    "mountain_car/cliff.soter",
    "testing/planner.soter",
    "generality/drag.soter",
    "generality/pendulum.soter",
    "generality/two_tanks.soter",
    "generality/lane.soter",
    "generality/altitude.soter",
)
GENERATED = ("soter_app.c", "soter_app.h")
"""Of the files `soter*` of a package; all others are the runtime."""
BESIDE = ("main.c", "Makefile", "README.md", ".soter-files.json", "SEAL")
"""The driver, and what lists the files or hashes them."""
Facts = dict[str, str]


def soter(checkout: Path, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """One command of a checkout."""
    return subprocess.run(
        (sys.executable, "-m", "soter.cli.main", *words),
        cwd=cwd,
        env={
            **os.environ,
            "PYTHONPATH": str(checkout / "src"),
            "SOTER_CACHE": str(checkout / "build" / "cache-of-comparison"),
        },
        capture_output=True,
        text=True,
        check=False,
    )


def digest(folder: Path) -> str:
    """Of all files below a folder that are not the runtime."""
    total = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = path.relative_to(folder).as_posix()
        runtime = path.name.startswith("soter") and path.name not in GENERATED
        if runtime or path.name in BESIDE:
            continue
        total.update(f"{name}\0".encode() + without_assumptions(path))
    return total.hexdigest()[:16]


def without_assumptions(path: Path) -> bytes:
    """A file's bytes; of a manifest without what assumptions are called."""
    if path.suffix != ".json":
        return path.read_bytes()
    document: Any = json.loads(path.read_bytes())
    for module in document.get("modules", ()) if isinstance(document, dict) else ():
        if isinstance(module, dict):
            module.pop("assumptions", None)
    if isinstance(document, dict):
        document.pop("soter", None)
    return json.dumps(document, sort_keys=True).encode()


def facts_of(checkout: Path, name: str, until: str) -> Facts:
    """What a checkout makes of one example."""
    facts: Facts = {}
    path = str(checkout / "examples" / name)
    with tempfile.TemporaryDirectory(prefix="same_") as work:
        cwd = Path(work)
        checked = soter(checkout, "check", path, "--json", cwd=cwd)
        facts["check"] = f"exit {checked.returncode}"
        if checked.returncode:
            return facts
        for system in json.loads(checked.stdout)["systems"]:
            which = ("--system", system["name"])
            out = cwd / f"out_{system['name']}"
            built = soter(checkout, "build", path, *which, "--target", "c", "-o", str(out), cwd=cwd)
            facts[f"{system['name']}: C"] = digest(out) if not built.returncode else "refused"
            ran = soter(checkout, "run", path, *which, "--until", until, "--json", cwd=cwd)
            told = json.loads(ran.stdout) if ran.stdout.startswith("{") else {}
            facts[f"{system['name']}: trace"] = str(told.get("trace_sha256", ran.returncode))[:16]
        if name in PROVED:
            proof = cwd / "proof"
            done = soter(checkout, "verify", path, "--json", "--cert", str(proof), cwd=cwd)
            modules = json.loads(done.stdout)["modules"]
            facts["verdicts"] = json.dumps(
                {
                    m: {n: p["verdict"] for n, p in v["properties"].items()}
                    for m, v in modules.items()
                }
            )
            facts["certificate"] = digest(proof)
    return facts


def main() -> int:
    """A row an example; 0 where nothing differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, required=True, help="the other checkout")
    parser.add_argument("--until", default="5s")
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    before = given.before.resolve()
    if not (before / "examples").is_dir():
        parser.error(f"{before} is no checkout of Soter")
    compared = differing = 0
    for path in sorted((ROOT / "examples").rglob("*.soter")):
        name = path.relative_to(ROOT / "examples").as_posix()
        if given.only not in name or not (before / "examples" / name).exists():
            continue
        if path.read_bytes() != (before / "examples" / name).read_bytes():
            print(f"{name}: another program by now", flush=True)
            continue
        old, new = (facts_of(c, name, given.until) for c in (before, ROOT))
        compared += len(old)
        wrong = [k for k in {**old, **new} if old.get(k) != new.get(k)]
        differing += len(wrong)
        for k in wrong:
            print(f"{name}: {k}: {old.get(k)} before, {new.get(k)} now", flush=True)
    print(f"\n{compared} facts of examples compared, {differing} differ; target 0")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
