"""From the wheel to a robot that is proved, re-checked and flown: what a stranger types and waits.

    .venv/bin/python bench/newcomers/from_wheel.py [--python PYTHON] [--everything] [--tools]

Purpose: the wheel of the last commit in an empty environment and an empty folder, with nothing of
Soter compiled before: `pip install`, `soter new`, and then, word for word, what that prints, up to
where the robot is proved, re-checked and flown, and to the end. Beside it what is on the disk:
bytes of files, without pip and setuptools; with --everything also of the extra `all`. With --tools
the same wheel is run by `pipx run` and installed by `uv tool install`. Times are of a wall clock,
and with them goes the load of the machine; packages of others come from an index, or from pip's
cache of it.
Non-goals: what a stranger understands of it.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from release.make_release import built, size, told  # noqa: E402 - needs the path

from soter.report.tables import table  # noqa: E402 - after it
from soter.version import DISTRIBUTION  # noqa: E402 - after it

FLOWN = ("soter verify", "soter recheck", "soter run")
"""What has been typed where the robot is proved, re-checked and has flown."""
ALONE = "--system Unguarded"
"""What is meant to end with 3."""


class Stranger:
    """An environment with pip and nothing else, an empty folder, and a shell in it."""

    def __init__(self, python: str, wheel: Path, at: Path) -> None:
        self.at, self.home, self.rows = at / "empty", at / "venv", list[tuple[str, int, float]]()
        self.at.mkdir(parents=True)
        told(python, "-m", "venv", self.home)
        self.python = self.home / "bin" / "python"
        own = {name: str(at / name) for name in ("PIPX_HOME", "PIPX_BIN_DIR", "UV_TOOL_DIR")}
        self.environment = {
            **{k: v for k, v in os.environ.items() if k != "PYTHONPATH"},
            **own,
            "PATH": os.pathsep.join((str(self.home / "bin"), os.environ["PATH"])),
            "SOTER_CACHE": str(at / "cache"),
            "PIP_FIND_LINKS": f"{os.environ.get('PIP_FIND_LINKS', '')} {wheel.parent}",
            "UV_TOOL_BIN_DIR": str(at / "tools"),
            "UV_PYTHON_DOWNLOADS": "never",
        }

    def types(self, line: str) -> str:
        """One line; what it prints."""
        began = time.monotonic()
        done = subprocess.run(
            shlex.split(line),
            cwd=self.at,
            env=self.environment,
            capture_output=True,
            text=True,
            check=False,
        )
        self.rows.append((line, done.returncode, time.monotonic() - began))
        if done.returncode != (3 if ALONE in line else 0):
            print(f"{line}: exit {done.returncode}\n{done.stdout}{done.stderr}", file=sys.stderr)
        return done.stdout


def printed(text: str) -> list[str]:
    """The commands below `next`, without what is said of them."""
    below = text.partition("\nnext\n")[2]
    return [line.strip().split("  ")[0] for line in below.splitlines() if line.strip()]


def afternoon(python: str, wheel: Path, at: Path) -> tuple[Stranger, int]:
    """Everything that `soter new` prints, behind an install by name, and the bytes of that."""
    stranger = Stranger(python, wheel, at)
    stranger.types(f"pip install --quiet '{DISTRIBUTION}[prove]'")
    whole = size(stranger.python)
    for line in printed(stranger.types("soter new rover")):
        stranger.types(line)
    return stranger, whole


def tools(python: str, wheel: Path, at: Path) -> list[tuple[str, int, float]]:
    """The wheel by pipx, for one command, and as a tool of uv."""
    stranger = Stranger(python, wheel, at)
    stranger.types("pip install --quiet pipx uv")
    stranger.types(f"pipx run --spec {wheel} {DISTRIBUTION} new a")
    stranger.types(f"uv tool install --quiet {wheel}")
    stranger.types(f"{at / 'tools' / 'soter'} check a/a.soter")
    return [
        (line.replace(f"{at}/", "").replace(str(wheel), "WHEEL"), code, seconds)
        for line, code, seconds in stranger.rows
    ]


def main() -> int:
    """Install, type, measure; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--python", default=sys.executable, help="whose empty environment it is")
    parser.add_argument("--everything", action="store_true", help="the extra `all`, too: minutes")
    parser.add_argument("--tools", action="store_true", help="pipx and uv, too")
    given = parser.parse_args()
    commit, epoch = told("git", "log", "-1", "--format=%H %ct").split()
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        (at / "dist").mkdir()
        for name, content in built(commit, int(epoch), at / "built").items():
            (at / "dist" / name).write_bytes(content)
        (wheel,) = (at / "dist").glob("*.whl")
        load = os.getloadavg()[0]
        stranger, prove = afternoon(given.python, wheel, at / "afternoon")
        rows = stranger.rows + (tools(given.python, wheel, at / "tools") if given.tools else [])
        sizes = {"core": _size_of(given.python, wheel, at / "core", ""), "[prove]": prove}
        if given.everything:
            sizes["[all]"] = _size_of(given.python, wheel, at / "all", "[all]")
    lines = [line for line, _, _ in rows]
    needed = 1 + max(next(i for i, x in enumerate(lines) if x.startswith(f)) for f in FLOWN)
    minutes = sum(seconds for _, _, seconds in rows[:needed]) / 60
    print(f"wheel of {commit[:12]}, load {load:.1f} on {os.cpu_count()} processors")
    shown = [(line, exit_, f"{seconds:.1f}") for line, exit_, seconds in rows]
    print(table(("typed", "exit", "seconds"), shown))
    figures = [
        ("commands to proved, re-checked, flown", f"{needed}", "<= 5"),
        ("minutes to there", f"{minutes:.1f}", "<= 3"),
        *((f"MB installed, {name}", f"{b / 1e6:.0f}", "") for name, b in sizes.items()),
    ]
    figures[2] = (*figures[2][:2], "<= 100")
    print(table(("figure", "measured", "target"), figures))
    failed = [line for line, exit_, _ in rows if exit_ != (3 if ALONE in line else 0)]
    return 0 if not failed and needed <= 5 and minutes <= 3 and sizes["core"] <= 100e6 else 1


def _size_of(python: str, wheel: Path, at: Path, extras: str) -> int:
    stranger = Stranger(python, wheel, at)
    stranger.types(f"pip install --quiet '{DISTRIBUTION}{extras}'")
    return size(stranger.python)


if __name__ == "__main__":
    sys.exit(main())
