"""Random tests on examples that nobody has seen, file by file, until the time is over.

    make soak N=600                                         ten minutes
    python tests/soak.py [--seconds 600] [--jobs 2] [FILE ...]

Purpose: each process is one file's tests marked `random`, with a seed of its own (`long_tests.py`,
`seeds`); what fails is told with the command that has it again, and the exit code is then 1. With
$SOTER_TEST_SCALE each test tries so many times as many examples.
Non-goals: how often a test meets what it looks for: with few examples such a count, which
some tests hold, may fall short by chance.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import secrets
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import processes
from long_tests import SEED

ROOT = Path(__file__).resolve().parents[1]
MARK = "@pytest.mark.random"
PYTEST = (sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider")
FAILED, NOTHING_TO_RUN = 1, 5


def files() -> list[str]:
    """Those with a random test that `make test` runs."""
    tests = sorted((ROOT / "tests").rglob("test_*.py"))
    return [str(p.relative_to(ROOT)) for p in tests if MARK in p.read_text(encoding="utf-8")]


def soaked(file: str, end: float) -> bool | None:
    """Whether its tests pass with a fresh seed; None: the time was over, or none is to run."""
    seed = 10**6 + secrets.randbelow(2**31)
    left = end - time.monotonic()
    if left <= 0.0:
        return None
    environment = {**os.environ, SEED: str(seed)}
    command = [*PYTEST, "-m", "random", file]
    pipes = {"stdout": processes.PIPE, "stderr": processes.STDOUT, "text": True}
    with processes.started(command, cwd=ROOT, env=environment, **pipes) as process:
        try:
            said, _ = process.communicate(timeout=left)
        except processes.TimeoutExpired:
            return None
    if process.returncode == NOTHING_TO_RUN:
        return None
    if process.returncode:
        failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE) or [file]
        again = [f"again: {SEED}={seed} {sys.executable} -m pytest '{test}'" for test in failed]
        print("\n".join([said, *again]), flush=True)
    else:
        print(f"{file} {SEED}={seed}: {said.splitlines()[-1]}", flush=True)
    return process.returncode == 0


def main() -> int:
    """Rounds over all files, each in another order; what failed is not asked again."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("files", nargs="*")
    asked = parser.parse_args()
    names, end = asked.files or files(), time.monotonic() + asked.seconds
    passed: list[bool | None] = []
    with ThreadPoolExecutor(asked.jobs) as pool:
        while names and time.monotonic() < end:
            random.shuffle(names)
            said = list(pool.map(lambda file: soaked(file, end), names))
            names = [n for n, ok in zip(names, said, strict=True) if ok]
            passed += said
    print(f"{passed.count(True)} files passed, {passed.count(False)} failed")
    return FAILED if False in passed else 0


if __name__ == "__main__":
    sys.exit(main())
