"""The figures of the house, and what the recut did to the time of commands.

    .venv/bin/python bench/house/house_figures.py [--against COMMIT] [--assertions] [--runs 5]

Purpose: counts over src/ as the tests assert them; with `--against` the same commands on that
commit and on this one, in turns, medians of CPU time; with `--assertions` the same commands with
the assertions of the C engines compiled out and in.
Non-goals: judging; the counting itself (tests/unit/test_house_figures.py, test_c_figures.py).
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT / "tests") not in sys.path:
    sys.path.insert(0, str(ROOT / "tests"))

from unit import test_c_figures as c_figures  # noqa: E402 - needs the path
from unit import test_docstrings as docstrings  # noqa: E402 - needs the path
from unit import test_house_figures as figures  # noqa: E402 - needs the path

COMMANDS = {
    "verify, cart": ("verify", "examples/wall/cart.soter", "--no-refute"),
    "test, two modules": ("test", "examples/testing/two_modules.soter"),
    "run, drone, 60 s": ("run", "examples/drone/motion_primitive.soter", "--until", "60s"),
    "check, drone": ("check", "examples/drone/motion_primitive.soter"),
}

ENGINES = {
    "verify, cart": ("verify", "examples/wall/cart.soter", "--no-refute"),
    "verify, drone": ("verify", "examples/drone/motion_primitive.soter", "--no-refute"),
    "test, two modules": ("test", "examples/testing/two_modules.soter", "--reduction", "sleep"),
}
UNCHECKED = """
import sys
from soter.explore.engine import engine
from soter.verify.enclose import library
for module in (engine, library):
    module.FLAGS = (*module.FLAGS, "-DSOTER_UNCHECKED")
from soter.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
"""The command line with engines that assert nothing."""


def counts() -> dict[str, object]:
    """What is counted, by the words of the page."""
    rooms = Counter(figures.room_of(p) for p in figures.trees() if p.name != "__init__.py")
    widest, size = rooms.most_common(1)[0]
    c = c_figures.all_functions()
    checks = sum(
        path.read_text(encoding="utf-8").count("SOTER_CHECK(")
        for path in (ROOT / "src" / "soter").rglob("*.[ch]")
        if path.name != "soter_check.h"
    )
    sources = docstrings.SOURCES
    return {
        "import circles, annotations included": len(figures.circles(figures.imports())),
        "files in the widest room": f"{size} ({widest})",
        "files over 500 lines": len(list(figures.long_files())),
        "functions over 70 lines, Python; C": (
            f"{len(list(figures.long_functions()))}; {sum(f[2] > c_figures.LONGEST for f in c)}"
        ),
        f"C functions with complexity over 10, of {len(c)}": sum(
            f[3] > c_figures.SIMPLE for f in c
        ),
        "calls with eight or more positional arguments": len(list(figures.long_calls())),
        "functions of arrays that state no shape": sum(
            len(docstrings.unsaid_shapes(p)) for p in sources
        ),
        "raisers that do not say so": sum(len(docstrings.unsaid_exceptions(p)) for p in sources),
        "assertions in the C engines": checks,
    }


def cpu(
    command: tuple[str, ...],
    root: Path,
    cache: str,
    started: tuple[str, ...] = ("-m", "soter.cli.main"),
) -> float:
    """CPU seconds of a command with the sources of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(root / "src"), "XDG_CACHE_HOME": cache}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [sys.executable, *started, *command]
    done = subprocess.run(words, cwd=root, env=environment, capture_output=True, check=False)
    assert done.returncode in {0, 3, 4}, done.stderr.decode()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def against(commit: str, runs: int) -> None:
    """Medians of both, in turns; the first run of each fills its cache."""
    with tempfile.TemporaryDirectory() as at:
        old = Path(at) / "old"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "-q", "--detach", str(old), commit], check=True)
        try:
            for root in (old, ROOT):
                words = [sys.executable, "-m", "compileall", "-q", str(root / "src")]
                subprocess.run(words, check=True)
            for name, command in COMMANDS.items():
                timings: list[list[float]] = [[], []]
                for run in range(runs + 1):
                    for times, root in zip(timings, (old, ROOT), strict=True):
                        took = cpu(command, root, str(Path(at) / f"cache-{root.name}"))
                        if run:
                            times.append(took)
                a, b = (statistics.median(times) for times in timings)
                print(f"{name:20} CPU {a:6.2f} s before, {b:6.2f} s now, ratio {b / a:.2f}")
        finally:
            subprocess.run([*git, "remove", "--force", str(old)], check=True)


def assertions(runs: int) -> None:
    """What the assertions of the engines cost, in turns; the first run of each compiles.

    Sets that were computed before are not reused: every run begins with the compiled engines only.
    """
    with tempfile.TemporaryDirectory() as at:
        for name, command in ENGINES.items():
            timings: list[list[float]] = [[], []]
            for run in range(runs + 1):
                for k, started in enumerate((("-c", UNCHECKED), ("-m", "soter.cli.main"))):
                    cache = Path(at) / f"cache-{k}"
                    for kept in cache.glob("**/*.npz"):
                        kept.unlink()
                    took = cpu(command, ROOT, str(cache), started)
                    if run:
                        timings[k].append(took)
            a, b = (statistics.median(times) for times in timings)
            print(f"{name:20} CPU {a:6.2f} s unchecked, {b:6.2f} s checked, ratio {b / a:.2f}")


def main() -> int:
    """Print the counts, and the times where there is a commit to compare with."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", help="a commit to compare times with")
    parser.add_argument("--assertions", action="store_true", help="compare with and without")
    parser.add_argument("--runs", type=int, default=5)
    arguments = parser.parse_args()
    for what, figure in counts().items():
        print(f"{what:50} {figure}")
    if arguments.against:
        against(arguments.against, arguments.runs)
    if arguments.assertions:
        assertions(arguments.runs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
