"""Packages of target `c`, made and built for tests; images for a Cortex-M, measured.

Purpose: one way to write a package and to compile it with flags of one's choice. What `make` has
built of exactly these files, with this compiler and these settings, is kept in Soter's cache as
compiled programs are: many tests, and every later run, build the same package.
Images for a Cortex-M: how large they are, with and without the test of the arithmetic, and the cart
whose AC is in C. Non-goals: what is in them; times: counts of an emulator are none.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import processes
import soter
from soter.api.deploy.building import built_image, stack_bound
from soter.native.cache import cached_folder, digest
from soter.native.compiler import find_compiler

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.targets.package import Package

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
MADE, SAID = "made.tar", "said.txt"

Done = processes.Done
Files = dict[str, str]


class NotMadeError(Exception):
    """What makes a package failed, and has said why: that is never kept."""

    def __init__(self, done: Done) -> None:
        super().__init__(done.stderr)
        self.done = done


def package(source: Path, folder: Path, system: str | None = None) -> Package:
    return soter.load(source).build("c", folder, system)


def command(words: list[str], folder: Path) -> Done:
    return processes.run(words, cwd=folder, capture_output=True, text=True, check=False)


def make(folder: Path, *settings: str, reads: tuple[Path, ...] = ()) -> Done:
    """`make` from nothing, with the compiler that Soter uses; or what it has made of the same.

    `reads`: files outside of the folder that the settings name.
    """
    compiler = find_compiler()
    words = ["make", "-B", f"CC={' '.join(compiler.command)}", *settings]
    if any(setting.startswith("CC=") for setting in settings):
        return command(words, folder)  # nothing identifies another compiler
    read = [hashlib.sha256(file.read_bytes()).hexdigest() for file in reads]
    try:
        said = made_or_kept("make", folder, [words], [compiler.identity, *read])
    except NotMadeError as error:
        return error.done
    return Done(words, 0, said, "")


def made_or_kept(
    kind: str,
    folder: Path,
    commands: list[list[str]],
    tools: list[str],
    wanted: Callable[[Path], bool] = Path.is_file,
) -> str:
    """What commands make of the files in a folder, or have made of the same; what they said.

    `tools`: what else that depends on, as text; `wanted`: of the files that are new. NotMadeError
    where one fails.
    """
    before = _files(folder)
    parts = [*tools, *(word for words in commands for word in words)]
    parts += [x for name, sha256 in sorted(before.items()) for x in (name, sha256)]

    def build(at: Path) -> None:
        said = ""
        for words in commands:
            done = command(words, folder)
            if done.returncode != 0:
                raise NotMadeError(done)
            said += done.stdout
        (at / SAID).write_text(said, encoding="utf-8")
        with tarfile.open(at / MADE, "w") as tar:
            for name, sha256 in sorted(_files(folder).items()):
                if before.get(name) != sha256 and wanted(folder / name):
                    tar.add(folder / name, name)

    at = cached_folder(kind, digest(parts), (MADE, SAID), build)
    with tarfile.open(at / MADE) as tar:
        for member in tar:
            file = tar.extractfile(member)
            assert file is not None
            made = folder / member.name
            made.parent.mkdir(parents=True, exist_ok=True)
            made.unlink(missing_ok=True)
            made.write_bytes(file.read())  # and so it is younger than its sources
            made.chmod(member.mode)
    return (at / SAID).read_text(encoding="utf-8")


def _files(folder: Path) -> Files:
    """Every file below a folder, and a hash of what is in it."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file()
    }


def trace(text: str) -> str:
    """The `trace_sha256` that a built program printed."""
    (line,) = [x for x in text.splitlines() if x.startswith("trace_sha256 ")]
    return line.split()[1]


FAST = re.compile(r"^node Fast .*?^}\n", re.MULTILINE | re.DOTALL)
FAST_IN_C = """\
extern node Fast period 10ms from "c:fast.c:fast" {
  subscribes motion, goal;
  publishes accel;
}
"""
FAST_SOURCE = """\
#include "cart.h"
int fast(const cart_SafeCart_Fast_in* in, cart_SafeCart_Fast_out* out) {
  const double u = 4.0 * (in->goal - in->motion.x) - 1.0 * in->motion.v;
  out->accel = u < -3.0 ? -3.0 : u > 3.0 ? 3.0 : u;
  out->has_accel = 1;
  return 0;
}
"""
UNTESTED = "bool soter_tested(const soter_program* p) {\n  (void)p;\n  return true;\n}\n"
SECTION = re.compile(
    r"^ (\.(?:text|rodata)\S*)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+) (\S+)$", re.MULTILINE
)
DOUBLES = re.compile(
    r"_arm_muldivdf3\.o|libgcc\.a\(_\w*df\w*\.o\)|libm\w*\.a|"
    r"compiler_rt\.(?!arm|int\b|udivmod|shift|mem|small)"
)
"""Of a section's name and its file; 64-bit integers and memory are not among them."""
COUNTED = re.compile(
    r"^interrupt to command (\d+) at most, (\d+) on average\n"
    r"interrupt to actuators (\d+) at most\n"
    r"\d+ instants, (\d+) longer than a tick\nstack (\d+) bytes used$",
    re.MULTILINE,
)


def made(package: Package, goal: str, *words: str) -> str:
    """What `make` says; CalledProcessError where it fails."""
    zig = f"ZIG={sys.executable} -m ziglang"
    command = ["make", "-s", "-C", str(package.folder), goal, zig, *words]
    return str(processes.run(command, check=True, capture_output=True, text=True).stdout)


def loop_image(package: Package) -> Path:
    """Where the image against the clock comes to be."""
    return package.folder / package.image.replace(".elf", "_loop.elf")


def sizes(image: Path) -> tuple[int, int]:
    """Bytes of flash, and of RAM with the stack."""
    words = ["arm-none-eabi-size", str(image)]
    said = str(processes.run(words, capture_output=True, text=True, check=True).stdout)
    text, data, bss = (int(x) for x in said.splitlines()[1].split()[:3])
    return text + data, data + bss


def without_test(package: Package, beside: Path) -> tuple[int, int]:
    """Flash of the loop's image without the test of the arithmetic, and of doubles in it.

    All that only the test needs goes with it: its words, and the doubles that nothing else uses.
    """
    shutil.copytree(package.folder, beside)
    start = beside / "soter_cortex_m.c"
    text, number = re.subn(
        r"static void say_bits.*\Z", UNTESTED, start.read_text(), flags=re.DOTALL
    )
    assert number == 1
    start.write_text(text)
    (program,) = [p for p in beside.glob("*.c") if ".self_test = soter_computes" in p.read_text()]
    program.write_text(program.read_text().replace(".self_test = soter_computes", ".self_test = 0"))
    (beside / loop_image(package).name).unlink(missing_ok=True)
    copied = type(package)(beside)
    made(copied, loop_image(package).name, "LOOP=-Wl,-Map=image.map")
    listed = (beside / "image.map").read_text().partition("Linker script and memory map")[2]
    doubles = sum(
        int(size, 16)
        for section, at, size, file in SECTION.findall(listed)
        if int(at, 16) > 0 and DOUBLES.search(f"{section} {file}")
    )
    return sizes(beside / loop_image(package).name)[0], doubles


def dm_and_gate(board: str) -> tuple[int, int]:
    """Instructions at most of a DM's step, and of the gate, of the cart whose AC is in C."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        text, number = FAST.subn(FAST_IN_C, (EXAMPLES / "wall" / "cart.soter").read_text())
        assert number == 1
        (here / "cart.soter").write_text(text)
        (here / "fast.c").write_text(FAST_SOURCE)
        program = soter.load(here / "cart.soter")
        package = program.build("cortex-m", here / "out", "Protected", board=board)
        image = built_image(package, board, stack_bound(package, board))
    assert image is not None
    assert image.instant_most is not None, image.why
    steps = {s.name: s.most for s in image.steps}
    return steps["SafeCart.dm"], steps["SafeCart.Fast"]
