"""What Soter makes of a dozen examples, as hashes: their C, their traces, the verdicts of proofs.

Purpose: two lines of docs/benchmarks/line.jsonl show which outputs a change made other ones. C is
what `soter build --target c` writes of every system, without the runtime; a trace is the hash of
`soter run` of seed 1 that the document has; verdicts are those of every property of every module.
As a command it compares two trees, this one and an older one with a `.venv`, by every example and
every program of other folders, their certificates included; what takes too long in a tree is not
asked, and counted.
Non-goals: whether any of them is right.

    python bench/house/example_outputs.py --before ../older ../shared/robots/*.soter
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


def soter(
    folder: Path,
    *words: str,
    tree: Path | None = None,
    seconds: int = 0,
    cache: Path | None = None,
) -> Any:  # noqa: ANN401 - a document of JSON
    """The document of a command, with its exit code as `exit`; all are compiled anew below it.

    `tree`: another one than this. `seconds` of the processor, if any, after which it is killed.
    """
    python = sys.executable if tree is None else str(tree / ".venv" / "bin" / "python")
    limited = ("bash", "-c", f'ulimit -t {seconds}; exec "$@"', "-") if seconds else ()
    done = subprocess.run(
        (*limited, python, "-m", "soter", *words, "--json"),
        cwd=folder,
        env={**os.environ, "SOTER_CACHE": str(cache or folder / "cache")},
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


# ------------------------------------------------------------ two trees


def outputs_of(
    tree: Path, path: Path, folder: Path, seconds: int, cache: Path | None = None
) -> dict[str, str]:
    """What a tree makes of a program, by what it is; without what took too long."""

    def ask(*words: str) -> Any:  # noqa: ANN401 - a document of JSON
        return soter(folder, *words, tree=tree, seconds=seconds, cache=cache)

    found: dict[str, str] = {}
    checked = ask("check", str(path))
    found["check"] = hashed([checked["exit"], codes_of(checked)])
    for system in checked.get("systems", []):
        name, out = system["name"], folder / system["name"]
        which = (str(path), "--system", name)
        built = ask("build", *which, "--target", "c", "-o", str(out))
        ran = ask("run", *which, "--until", UNTIL, "--seed", "1")
        cert = folder / f"{name}.cert"
        proved = ask("verify", *which, "--no-refute", "--cert", str(cert))
        if built["exit"] >= 0:
            found[f"C of {name}"] = hashed([built["exit"], codes_of(built), generated(out)])
        if ran["exit"] >= 0:
            found[f"trace of {name}"] = hashed([ran["exit"], ran.get("trace_sha256")])
        if proved["exit"] >= 0:
            claims = {m: x["properties"] for m, x in proved.get("modules", {}).items()}
            verdicts = [(m, c, x["verdict"]) for m, of in claims.items() for c, x in of.items()]
            found[f"verdicts of {name}"] = hashed([proved["exit"], codes_of(proved), verdicts])
            found[f"certificate of {name}"] = certificate(cert)
    return found


def codes_of(document: Any) -> list[str]:  # noqa: ANN401 - a document of JSON
    """The codes of its diagnostics."""
    return [d.get("code", "") for d in document.get("diagnostics", [])]


def certificate(folder: Path) -> str:
    """Of the tables of a certificate, and what its manifest says but for versions and times."""
    written = []
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        said: Any = file.read_bytes()
        if file.suffix == ".json":
            read = json.loads(said)
            said = {k: x for k, x in read.items() if k in ("modules", "system", "levels")}
        written.append((str(file.relative_to(folder)), said))
    return hashed(written)


def main() -> None:
    """Print what differs, a line each, and how many were compared."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--before", type=Path, required=True, help="the folder of an older tree")
    parser.add_argument("--seconds", type=int, default=60, help="of the processor, a command")
    parser.add_argument("programs", type=Path, nargs="*", help="besides examples/*/*.soter")
    options = parser.parse_args()
    before, equal, unasked, differing = options.before.resolve(), 0, 0, 0
    own = sorted((ROOT / "examples").glob("*/*.soter"))
    caches = [Path(tempfile.mkdtemp()) for _ in range(2)]
    for path in [*own, *(p.resolve() for p in options.programs)]:
        older = before / path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
        if not older.exists():
            continue
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
            now = outputs_of(ROOT, path, Path(one), options.seconds, caches[0])
            was = outputs_of(before, older, Path(other), options.seconds, caches[1])
        for what in sorted(now.keys() | was.keys()):
            if what not in now or what not in was:
                unasked += 1
            elif now[what] == was[what]:
                equal += 1
            else:
                differing += 1
                print(f"differs  {path.name}: {what}", flush=True)
    print(f"{equal} equal, {differing} differ, {unasked} took over {options.seconds} s")


if __name__ == "__main__":
    main()
