"""The figures of the house.

    .venv/bin/python bench/house/house_figures.py

Purpose: counts over src/ as the tests assert them, the files of Python that commands enter,
changes of room (room_changes.py), and what a check takes beside an import of NumPy.
Non-goals: judging; the counting itself (tests/unit/test_house_figures.py, test_c_figures.py).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from bench.quick import SOTER, processor_s  # noqa: E402 - needs the path

from unit import test_c_figures as c_figures  # noqa: E402 - needs the path
from unit import test_docstrings as docstrings  # noqa: E402 - needs the path
from unit import test_house_figures as figures  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Iterator

CART = "examples/wall/cart.soter"
ENTERED = """
import inspect
import sys
entered = set()
def see(frame, event, _):
    code = frame.f_code
    function = code.co_flags & inspect.CO_OPTIMIZED and not code.co_name.startswith("<")
    ours = "/soter/" in code.co_filename and code.co_filename.endswith(".py")
    if event == "call" and function and ours:
        entered.add(code.co_filename)
sys.setprofile(see)
from soter.cli.main import main
main(sys.argv[1:])
sys.setprofile(None)
print("entered", len(entered), file=sys.stderr)
"""
"""A command line that counts the files of Python of which a function is called: no template."""


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
    sources = figures.SOURCES
    rooms_of, sums = figures.sizes().values(), figures.sums()
    python, lines, everything = (
        sum(r[k] for r in rooms_of) for k in ("statements", "lines", "all")
    )
    complex_ones = figures.complex_functions()
    return {
        "files of Python in src": len(figures.trees()),
        "statements of Python": f"{python:,}",
        "lines of Python; of all that is written by hand": f"{lines:,}; {everything:,}",
        "lines of Python in the core, without add-ons": f"{sums['core_rooms']['lines']:,}",
        "functions with complexity over 15 by radon; worst": (
            f"{len(complex_ones)}; {complex_ones[0][0]}"
        ),
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


def entered(*words: str) -> int:
    """Of how many files of Python of Soter a command calls a function, threads aside.

    Templates (`*.j2`), which run as functions of Jinja, are no files of Python.
    """
    with tempfile.TemporaryDirectory() as at:
        given = [at if word == "DIR" else word for word in words]
        done = subprocess.run(
            [sys.executable, "-c", ENTERED, *given],
            cwd=ROOT,
            env={**os.environ, "XDG_CACHE_HOME": at, "SOTER_CACHE": f"{at}/cache"},
            capture_output=True,
            text=True,
            check=False,
        )
    return int(done.stderr.rsplit("entered", 1)[1])


def beside_numpy() -> Iterator[tuple[str, float]]:
    """A small and a large program: how many times an import of NumPy its check takes."""
    numpy_s = processor_s("-c", "import numpy")
    for program in (CART, "examples/drone/surveillance.soter"):
        yield Path(program).name, processor_s(*SOTER, "check", program) / numpy_s


def main() -> int:
    """Print the counts, then what a check takes beside an import of NumPy."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    commands = (
        ("check", CART),
        ("build", CART, "--target", "c", "-o", "DIR"),
        ("verify", CART, "--no-refute"),
    )
    named = {f"files that `soter {c[0]}` of the cart enters": entered(*c) for c in commands}
    for what, figure in (counts() | named).items():
        print(f"{what:50} {figure}")
    walk = [sys.executable, "bench/house/room_changes.py"]
    print(subprocess.run(walk, cwd=ROOT, capture_output=True, text=True, check=True).stdout, end="")
    for program, ratio in beside_numpy():
        name = f"`soter check` of {program} beside `import numpy`"
        print(f"{name:50} {ratio:.1f} times")
    return 0


if __name__ == "__main__":
    sys.exit(main())
