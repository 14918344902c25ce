"""Packages of target `c`, made and built for tests.

Purpose: one way to write a package and to compile it with flags of one's choice.
Non-goals: what is in them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import processes
import soter
from soter.native.compiler import find

if TYPE_CHECKING:
    from soter.targets.package import Package

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"

Done = processes.Done


def package(source: Path, folder: Path, system: str | None = None) -> Package:
    return soter.load(source).build("c", folder, system)


def command(words: list[str], folder: Path) -> Done:
    return processes.run(words, cwd=folder, capture_output=True, text=True, check=False)


def make(folder: Path, *settings: str) -> Done:
    """`make` from nothing, with the compiler that Soter uses."""
    return command(["make", "-B", f"CC={' '.join(find().command)}", *settings], folder)


def trace(text: str) -> str:
    """The `trace_sha256` that a built program printed."""
    (line,) = [x for x in text.splitlines() if x.startswith("trace_sha256 ")]
    return line.split()[1]
