"""Packages of target `posix`, made, built and run for tests.

Purpose: the cart with an AC in a process of its own, in C, and what its report says.
Non-goals: judging how late a machine is: tests judge what was seen and done about it.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import processes
import soter
from generators.packages import CART, make

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FORGIVING = ("--late", "1000000")
"""A second, so that a busy machine is no miss."""
QUIET = ("--quiet", "--json")
FAST = """\
#include "cart.h"

int fast_step(const cart_SafeCart_Fast_in *in, cart_SafeCart_Fast_out *out) {
  const double wanted = 4.0 * (in->goal - in->motion.x) - 1.0 * in->motion.v;
  out->accel = wanted < -3.0 ? -3.0 : wanted > 3.0 ? 3.0 : wanted;
  out->has_accel = 1;
  return 0;
}
"""


def cart_with_extern(folder: Path, binding: str = "c:fast.c:fast_step") -> Path:
    """The cart's program, its AC an extern node."""
    text = CART.read_text()
    begin, end = text.index("node Fast"), text.index("// Safe: returns")
    node = f"""extern node Fast period 10ms from "{binding}" {{
  subscribes motion, goal;
  publishes accel;
}}

"""
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / "cart.soter"
    source.write_text(text[:begin] + node + text[end:])
    return source


def built(source: Path, folder: Path, *goals: str, strict: str = "-Werror") -> Path:
    """The program of a package, compiled without a warning."""
    soter.load(source).build("posix", folder)
    done = make(folder, f"CFLAGS=-O2 {strict}", *goals)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / source.stem


def cart_in_c(folder: Path, code: str = FAST) -> Path:
    """The cart, its AC a program of its own in C."""
    source = cart_with_extern(folder / "source")
    (source.parent / "fast.c").write_text(code)
    return built(source, folder / "out")


def worker_in_c(folder: Path, code: str) -> str:
    """The cart's worker alone, of any code, as an option of a program that is built already."""
    source = cart_with_extern(folder / "source")
    (source.parent / "fast.c").write_text(code)
    out = folder / "out"
    built(source, out, "cart_SafeCart_Fast", strict="-w")
    return f"Fast=exec {out / 'cart_SafeCart_Fast'}"


def report(program: Path, *options: str, expected: Sequence[int] = (0,)) -> dict[str, Any]:
    """The JSON report of a run."""
    done = processes.run(
        [program, *QUIET, *options], cwd=program.parent, capture_output=True, text=True, timeout=60
    )
    assert done.returncode in expected, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def end_of(source: Path, until: str, **options: Any) -> str:
    """What the trace of a run in virtual time hashes to."""
    found = soter.load(source).simulate(until=until, **options).trace_sha256
    assert found is not None
    return found
