"""Honest robots as they stand: what `soter verify` says at the first attempt, and `recheck`.

    .venv/bin/python bench/newcomers/first_attempt.py [--folder ../shared/robots] [NAME ...]

Purpose: a row a program: proved in full or what is not, CPU seconds of both commands, and whether
the certificate is accepted. Nothing is changed, and no advice is followed.
Non-goals: advice (`robots.py`), wrong variants (`bench/wrong_modules`).
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LONGEST_S = 900.0
"""CPU seconds that a command may take."""
HEAD = "| robot | at the first attempt | CPU s | recheck | CPU s |"


def run(*arguments: str, folder: Path) -> tuple[dict[str, Any], float]:
    """The document of a command, {} where it took too long, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(LONGEST_S), int(LONGEST_S) + 5))

    command = [sys.executable, "-m", "soter", *arguments, "--json"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=folder, preexec_fn=limited
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout) if done.stdout.strip() else {}, cpu_s


def said(document: dict[str, Any]) -> str:
    """The verdict: what is not proved of it, or the code of what was refused."""
    if not document:
        return f"no verdict in {LONGEST_S:.0f} s"
    errors = [d["code"] for d in document.get("diagnostics", []) if d["severity"] == "error"]
    if errors:
        return f"error {errors[0]}"
    verdicts = []
    for module in document["modules"].values():
        open_ = [c for c, f in module["properties"].items() if f["verdict"] == "undecided"]
        verdicts.append(f"undecided: {', '.join(open_)}" if open_ else str(module["verdict"]))
    return "; ".join(verdicts)


def main(argv: list[str]) -> int:
    """0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(argv)
    first = accepted = 0
    print(f"{HEAD}\n|{'---|' * (HEAD.count('|') - 1)}")
    programs = sorted(options.folder.glob("*.soter"))
    asked = [p for p in programs if not options.names or p.stem in options.names]
    for path in asked:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / path.name).write_bytes(path.read_bytes())
            verified, cpu_s = run("verify", path.name, "--cert", "proof", folder=Path(folder))
            checked: dict[str, Any] = {}
            verdict, again_s = said(verified), 0.0
            if verdict == "proved":
                checked, again_s = run("recheck", "proof", folder=Path(folder))
        first += verdict == "proved"
        accepted += checked.get("verdict") == "accepted"
        again = f"{checked.get('verdict', '-')} | {again_s:.0f}" if checked else "- | -"
        print(f"| {path.stem} | {verdict} | {cpu_s:.0f} | {again} |", flush=True)
    print(f"\n{first} of {len(asked)} proved at the first attempt, {accepted} of these accepted")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
