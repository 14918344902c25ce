"""Packages of examples, as `soter build` writes them, for the benches of each middleware.

Purpose: `written` writes the package of a system; `by_cmake` compiles one that needs CMake alone.
Non-goals: nodes beside it, and what installs a package of ROS 2 (`ros2_nodes.py`).
"""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def written(
    target: str, example: Path, system: str, mapping: Path, folder: Path, actuate: str = ""
) -> Path:
    """The folder of the package, not compiled yet; `actuate`: the text of its `actuate.c`."""
    words = [sys.executable, "-m", "soter", "build", str(example), "--system", system]
    words += ["--target", target, "--map", str(mapping), "-o", str(folder)]
    subprocess.run(words, check=True, capture_output=True)
    if actuate:
        (folder / "trusted" / "actuate.c").write_text(actuate)
    return folder


def by_cmake(package: Path) -> Path:
    """The folder of its programs."""
    build = package / "build"
    for step in (["-S", str(package), "-B", str(build)], ["--build", str(build)]):
        subprocess.run(["cmake", *step], check=True, capture_output=True)
    return build
