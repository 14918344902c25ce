"""Packages of target `posix`, made, built and run for tests.

Purpose: the cart with an AC in a process of its own, in C, and what its report says. A program that
is built with `owned` runs over a clock and a scheduler of the test's (`owned_clock.c`): nothing
that it reports depends on when the machine schedules whom.
Non-goals: judging how late a machine is: tests judge what was seen and done about it.
"""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import processes
import soter
from generators.c_packages import CART, make
from soter.simulate.real_time import BuiltPackage

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FORGIVING = ("--late", "1000000", "--misses", "1000000")
"""A second, so that a busy machine is no miss; and misses are no failure."""
QUIET = ("--quiet", "--json")
PATIENT = ("--wait", "600")
"""As long as a process that hangs is given: workers may start slowly on a busy machine."""
OWNED_CLOCK = Path(__file__).with_name("owned_clock.c")
WRAPPED = ("clock_gettime", "clock_nanosleep", "soter_posix_run")
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


def owned(source: Path, folder: Path, system: str | None = None) -> Path:
    """The same over the clock and the scheduler of the test; workers are as they are shipped.

    Compiled quickly: the bits are the same at every level, and the time is the test's.
    """
    trusted, *workers = soter.load(source).build("posix", folder, system).programs
    wraps = ",".join(f"--wrap={name}" for name in WRAPPED)
    flags = f"CFLAGS=-O0 -Werror -Wl,{wraps} {OWNED_CLOCK}"
    compiled = [make(folder, flags, trusted, reads=(OWNED_CLOCK,))]
    compiled += [make(folder, "CFLAGS=-O0 -Werror", *workers)] if workers else []
    assert all(done.returncode == 0 for done in compiled), compiled
    return folder / trusted


@contextmanager
def over(program: Path, *events: str) -> Iterator[None]:
    """`soter run --real-time` runs this program, which is `owned`, in place of what it builds."""
    with pytest.MonkeyPatch.context() as patch:
        made = BuiltPackage(program.parent, program.name)
        patch.setattr("soter.simulate.real_time.build_package", lambda *_: made)
        patch.setenv("OWNED_CLOCK", " ".join(events))
        yield


def cart_in_c(folder: Path, code: str = FAST) -> Path:
    """The cart, its AC a program of its own in C, over the clock of the test."""
    source = cart_with_extern(folder / "source")
    (source.parent / "fast.c").write_text(code)
    return owned(source, folder / "out")


def worker_in_c(folder: Path, code: str) -> str:
    """The cart's worker alone, of any code, as an option of a program that is built already."""
    source = cart_with_extern(folder / "source")
    (source.parent / "fast.c").write_text(code)
    out = folder / "out"
    built(source, out, "cart_SafeCart_Fast", strict="-w")
    return f"Fast=exec {out / 'cart_SafeCart_Fast'}"


def report(
    program: Path, *options: str, events: Sequence[str] = (), expected: int = 0
) -> dict[str, Any]:
    """The JSON report of a run; `events` of `owned_clock.c`, where the program has that."""
    done = processes.run(
        [program, *QUIET, *PATIENT, *options],
        cwd=program.parent,
        capture_output=True,
        text=True,
        env={**os.environ, "OWNED_CLOCK": " ".join(events)},
    )
    assert done.returncode == expected, done.stdout + done.stderr
    run_report: dict[str, Any] = json.loads(done.stdout)
    return run_report


def end_of(source: Path, until: str, **options: Any) -> str:
    """What the trace of a run in virtual time hashes to."""
    digest = soter.load(source).simulate(until=until, **options).trace_sha256
    assert digest is not None
    return digest
