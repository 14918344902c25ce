"""The help of `soter verify` where a robot is not proved, line by line, and what readers judged.

    .venv/bin/python bench/newcomers/help_lines.py [--folder ../shared/robots] [--budget 0s]
        [--cpu-s 300] [--variants N] [--kept .soter/newcomers] [NAME ...]

Purpose: each robot as it stands, and with `--variants` the first N wrong variants of each one that
`wrong_robots.py` has, is verified with its advice. `--budget`: of the search for other hints, which
is not what is asked here; `--cpu-s`: when a run is ended. A line a run:
the first claim that is open, whether what is told was tried, what readers wrote of it in
`help_judged.txt` (right, misleading, or little: true, and no help), and the help. Then how many of
each. Answers are kept, by program and the tool's sources.
Non-goals: what following the advice leads to (`first_attempt.py`).
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from bench.newcomers.first_attempt import kept, tool  # noqa: E402 - needs the path
from bench.newcomers.wrong_robots import VARIANTS, edited  # noqa: E402

JUDGED = HERE / "help_judged.txt"
"""Lines `word | run | beginning of the help`; of a run the first that fits counts."""


def first_help(text: str) -> dict[str, Any]:
    """The first claim of a run that is explained, and its help; both "" where nothing is open."""
    claim = ""
    for line in text.splitlines():
        if found := re.match(r"error\[(\w+)\]|(P\d\w?|ttf|safer|start|failsafe)  ", line):
            claim = found[1] or found[2]
        if line.startswith(("  help   ", "   = help: ")) and claim:
            return {"claim": claim, "help": line.partition("help")[2].lstrip(": ")}
    return {"claim": "", "help": ""}


def asked(name: str, text: str, budget: str, cpu_s: int) -> dict[str, Any]:
    """What `soter verify` tells of a program within so many CPU seconds."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 5))

    with tempfile.TemporaryDirectory() as place:
        (Path(place) / f"{name}.soter").write_text(text)
        command = [sys.executable, "-m", "soter", "verify", f"{name}.soter", "--budget", budget]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=place, preexec_fn=limited
        )
    return {"code": done.returncode, **first_help(done.stdout or done.stderr)}


def judged(run: str, help_: str) -> str:
    """What readers wrote of a help; "not judged" where they did not."""
    for line in JUDGED.read_text(encoding="utf-8").splitlines():
        word, _, rest = line.partition(" | ")
        name, _, begins = rest.partition(" | ")
        if name == run and begins and help_.startswith(begins):
            return word
    return "not judged"


def main(argv: list[str]) -> int:
    """Prints the lines and the sums."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT.parent / "shared" / "robots")
    parser.add_argument("--budget", default="0s")
    parser.add_argument("--cpu-s", type=int, default=300)
    parser.add_argument("--variants", type=int, default=0)
    parser.add_argument("--kept", type=Path, default=ROOT / ".soter" / "newcomers")
    parser.add_argument("names", nargs="*", metavar="NAME")
    options = parser.parse_args(argv)
    sums: Counter[str] = Counter()
    for file in sorted(options.folder.glob("*.soter")):
        if options.names and file.stem not in options.names:
            continue
        text = file.read_text(encoding="utf-8")
        runs = {file.stem: text}
        for wrong in VARIANTS.get(file.stem, ())[: options.variants]:
            runs[f"{file.stem}: {wrong.why}"] = edited(text, wrong)
        for run, program in runs.items():
            limits = options.budget, options.cpu_s
            about = ("help", tool(), str(limits), program)
            told = kept(options.kept, about, partial(asked, file.stem, program, *limits))
            if told["code"] == 0:
                continue
            help_ = told["help"]
            what = judged(run, help_) if help_ else "no verdict" if told["code"] < 0 else "no help"
            tried = "(tried" in help_
            sums.update([what, "tried"] if tried else [what])
            shown = "tried" if tried else ""
            print(f"| {run} | {told['claim']} | {shown} | {what} | {help_} |", flush=True)
    print(", ".join(f"{count} {word}" for word, count in sums.most_common()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
