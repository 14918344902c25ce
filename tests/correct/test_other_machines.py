"""The packages of the shipped examples compute the same bits on other processors.

Built by a cross compiler and run by QEMU in user mode; where one of them is not installed its tests
say so.
"""

from __future__ import annotations

import shutil
from functools import lru_cache
from typing import TYPE_CHECKING

import pytest

from generators.c_packages import command, make, trace
from generators.shipped_programs import ROOT, files, subjects_of
from soter.core.steps import lower
from soter.simulate.run import NativeProgram
from soter.targets.c99 import c99_package

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from generators.engine_comparison import Subject

MACHINES = {
    "aarch64": ("aarch64-linux-gnu-gcc", "qemu-aarch64"),
    "armhf": ("arm-linux-gnueabihf-gcc", "qemu-arm"),
    "riscv64": ("riscv64-linux-gnu-gcc", "qemu-riscv64"),
}
INSTANTS = 200


@lru_cache(maxsize=1)
def subjects() -> tuple[Subject, ...]:
    """The first system of every example that needs nobody's answers and nobody's messages.

    The package of one with external topics is a library for somebody's loop.
    """
    return tuple(
        s
        for path in files("examples")
        for s in subjects_of(path, INSTANTS)[:1]
        if not s.system.externals
    )


@lru_cache(maxsize=64)
def trace_here(number: int) -> str | None:
    s = subjects()[number]
    return NativeProgram(s.system).run(s.until_ns, s.seed, hash_trace=True).trace_sha256


def traces(machine: str, some: Sequence[Subject], tmp_path: Path) -> dict[str, str]:
    """What other machines compute, by the names of the subjects."""
    compiler, emulator = MACHINES[machine]
    absent = [tool for tool in (compiler, emulator, "make") if shutil.which(tool) is None]
    if absent:
        pytest.skip(f"not installed: {', '.join(absent)}")
    there: dict[str, str] = {}
    for s in some:
        package = c99_package(s.system, lower(s.system), tmp_path / s.name).write()
        built = make(package.folder, f"CC={compiler} -static", "CFLAGS=-O1")
        assert built.returncode == 0, (s.name, built.stderr)
        settings = ["--seed", str(s.seed), "--until", f"{s.until_ns}e-9"]
        ran = command([emulator, package.commands[1], *settings], tmp_path)
        assert ran.returncode in {0, 3}, (s.name, ran.stderr)
        there[s.name] = trace(ran.stdout)
    return there


@pytest.mark.parametrize("machine", MACHINES)
def test_the_cart_has_the_same_trace(machine: str, tmp_path: Path) -> None:
    (cart,) = subjects_of(ROOT / "examples" / "wall" / "cart.soter", INSTANTS)[:1]
    here = NativeProgram(cart.system).run(cart.until_ns, cart.seed, hash_trace=True).trace_sha256
    assert traces(machine, [cart], tmp_path) == {cart.name: here}


@pytest.mark.long
@pytest.mark.parametrize("machine", MACHINES)
def test_every_example_has_the_same_trace(machine: str, tmp_path: Path) -> None:
    there = traces(machine, subjects(), tmp_path)
    assert len(there) > 10, "examples were not found"
    assert there == {s.name: trace_here(i) for i, s in enumerate(subjects())}
