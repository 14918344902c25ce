"""What images for a Cortex-M take: flash, RAM, stack, and instructions under QEMU.

    .venv/bin/python bench/bare_metal/cortex_m.py

Purpose: issue 33's table. Examples with their plants in virtual time, whose trace has to be the
host's, and against the clock, from the interrupt of an instant to its commands; the trusted part
alone in its time-triggered loop, what the test of the arithmetic and the doubles take told apart;
every step of a DM, and the gate of an AC in C. Instructions are those of ten equal runs.
Non-goals: times. No hardware is asked: counts of an emulator are none.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import soter
from soter.api.deploying import image_of, stack_bound
from soter.diagnostics.diagnostic import SoterError
from soter.report.tables import table
from soter.targets.cortex_m_board import read_board
from soter.targets.cortex_m_package import missing_tools

if TYPE_CHECKING:
    from soter.targets.cortex_m_package import Image
    from soter.targets.package import Package

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
CORES = {"mps2-an386": "M4", "mps2-an500": "M7", "microbit": "M0"}
LARGE = ("mps2-an386", "mps2-an500")
WHOLE = (
    ("cart", "wall/cart.soter", None),
    ("mountain car", "mountain_car/cliff.soter", None),
    ("drone", "drone/motion_primitive.soter", "Protected"),
    ("surveillance", "drone/campaign.soter", "Surveillance"),
)
DRONE = f"""\
soter 1;
import "{EXAMPLES / "drone" / "motion_primitive.soter"}" as drone;
import "{EXAMPLES / "drone" / "iris.soter"}" as iris;
system Vehicle default {{
  external topic iris.localPosition every 5ms;
  external topic drone.control;
  node drone.Mission;
  module drone.SafeMotionPrimitive;
  node drone.Shaper;
}}
"""
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
TABLES = re.compile(r"^\d+ (\d+) \w \w+_(?:TABLE|EDGES)$", re.MULTILINE)
COUNTED = re.compile(
    r"^interrupt to command (\d+) at most, (\d+) on average\n"
    r"interrupt to actuators (\d+) at most\n"
    r"\d+ instants, (\d+) longer than a tick\nstack (\d+) bytes used$",
    re.MULTILINE,
)
UNTIL = re.compile(r"^UNTIL_NS := (\d+)$", re.MULTILINE)
LOOPED_NS = 60 * 10**9
RUNS = 10
SLOWEST = 5
NO_TICK = " 0 longer than a tick"


@dataclass(frozen=True)
class LoopCounts:
    """Instructions from the interrupt of an instant to its commands, and of a tick; stack used."""

    most: int
    mean: int
    tick: int
    stack: int


def made(package: Package, goal: str, *words: str) -> str:
    """What `make` says; CalledProcessError where it fails."""
    zig = f"ZIG={sys.executable} -m ziglang"
    command = ["make", "-s", "-C", str(package.folder), goal, zig, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def loop_image(package: Package) -> Path:
    """Where the image against the clock comes to be."""
    return package.folder / package.image.replace(".elf", "_loop.elf")


def looped(package: Package) -> LoopCounts:
    """Ten equal runs of the loop.

    They end when the package's run does, or after LOOPED_NS, as every tick is emulated. An
    instruction takes two to `shift` ns: the more, the finer SysTick counts them, and the less, the
    fewer ticks interrupt an instant and are counted with it.
    """
    said: set[str] = set()
    for shift in range(SLOWEST, -1, -1):
        loop_image(package).unlink(missing_ok=True)
        until = min(LOOPED_NS, int(UNTIL.findall((package.folder / "Makefile").read_text())[0]))
        loop = f"LOOP=-DSOTER_COUNTED={2**shift} -DAPP_TRACED_NS={until}LL"
        words = ("run-loop", loop, f"ICOUNT={shift}")
        said = {made(package, *words)}
        if NO_TICK in next(iter(said)):
            break
    said |= {made(package, *words) for _ in range(RUNS - 1)}
    (text,) = said
    told = COUNTED.search(text)
    assert told is not None
    most, mean, tick, _, stack = (int(x) for x in told.groups())
    return LoopCounts(most, mean, tick, stack)


def ten_equal(package: Package, board: str) -> Image:
    """The image, run ten times."""
    stack = stack_bound(package, board)
    (image,) = {image_of(package, board, stack) for _ in range(RUNS)}
    assert image is not None
    assert image.instant_most is not None, image.why
    return image


def tables_of(package: Package) -> int:
    """Bytes of tables of computed predicates in flash."""
    words = ["arm-none-eabi-nm", "--print-size", "--radix=d", str(package.folder / package.image)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return sum(int(size) for size in TABLES.findall(said))


def replayed(
    name: str, file: str, system: str | None, board: str, steps: list[list[str]]
) -> list[str]:
    """A row of an example with its plants; rows of its DMs are added to `steps`."""
    with tempfile.TemporaryDirectory() as folder:
        program = soter.load(EXAMPLES / file)
        package = program.build("cortex-m", Path(folder) / "out", system, board=board)
        stack = stack_bound(package, board)
        try:
            image = ten_equal(package, board)
        except SoterError as error:
            return [name, CORES[board], *["-"] * 9, error.diagnostics[0].message]
        tables, loop = tables_of(package), looped(package)
    steps += [
        [name, CORES[board], s.name, f"{s.most:,}", f"{s.mean:,}", f"{s.number:,}"]
        for s in image.steps
        if s.name.endswith(".dm")
    ]
    return [
        name,
        CORES[board],
        f"{image.flash:,}",
        f"{tables:,}",
        f"{image.ram:,}",
        f"{stack.bytes:,}",
        f"{image.stack_used:,}",
        f"{image.instant_most:,}",
        f"{image.instant_mean:,}",
        f"{loop.most:,}",
        f"{loop.mean:,}",
        "same" if image.same_as_host else "-",
    ]


def sizes(image: Path) -> tuple[int, int]:
    """Bytes of flash, and of RAM with the stack."""
    words = ["arm-none-eabi-size", str(image)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
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


def trusted(name: str, file: Path, board: str) -> list[str]:
    """A row of a trusted part in its loop, without plants."""
    with tempfile.TemporaryDirectory() as folder:
        package = soter.load(file).build("cortex-m", Path(folder) / "out", board=board)
        stack = stack_bound(package, board)
        run = ten_equal(package, board)
        made(package, loop_image(package).name)
        flash, ram = sizes(loop_image(package))
        bare, doubles = without_test(package, Path(folder) / "bare")
        loop = looped(package)
    return [
        name,
        CORES[board],
        f"{flash:,}",
        f"{flash - bare:,}",
        f"{doubles:,}",
        f"{bare - doubles:,}",
        f"{ram - read_board(board).stack_bytes:,}",
        f"{stack.bytes:,}",
        f"{loop.stack:,}",
        f"{loop.most:,}",
        f"{loop.mean:,}",
        f"{loop.tick:,}",
        f"{run.self_test:,}",
    ]


def gated(board: str) -> list[str]:
    """A row of the cart whose AC is in C: its DM, and the gate that its outputs go through."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        text, number = FAST.subn(FAST_IN_C, (EXAMPLES / "wall" / "cart.soter").read_text())
        assert number == 1
        (here / "cart.soter").write_text(text)
        (here / "fast.c").write_text(FAST_SOURCE)
        program = soter.load(here / "cart.soter")
        package = program.build("cortex-m", here / "out", "Protected", board=board)
        steps = {s.name: s for s in ten_equal(package, board).steps}
    dm, gate = steps["SafeCart.dm"], steps["SafeCart.Fast"]
    return [CORES[board], f"{dm.most:,}", f"{gate.most:,}", f"{dm.most + gate.most:,}"]


def main() -> int:
    """Print the tables."""
    for board in CORES:
        if missing_tools(read_board(board)):
            print(missing_tools(read_board(board)))
            return 1
    steps: list[list[str]] = []
    rows = [replayed(name, file, of, board, steps) for name, file, of in WHOLE for board in CORES]
    heads = ["with its plants", "core", "flash", "tables", "RAM", "trusted stack", "stack used"]
    counts = ["an instant", "on average", "to commands", "on average"]
    print(table([*heads, *counts, "trace"], rows))
    print()
    print(table(["a step of a DM", "core", "which", "at most", "on average", "steps"], steps))
    print()
    heads = ["cart, AC in C", "a step of the DM", "the gate", "together"]
    print(table(heads, [gated(board) for board in CORES]))
    with tempfile.TemporaryDirectory() as folder:
        drone = Path(folder) / "vehicle.soter"
        drone.write_text(DRONE, encoding="utf-8")
        cart = EXAMPLES / "wall" / "cart_firmware.soter"
        rows = [trusted(n, f, b) for n, f in (("cart", cart), ("drone", drone)) for b in LARGE]
    heads = ["trusted part", "core", "flash", "its test", "doubles", "the rest", "RAM"]
    counts = ["stack bound", "stack used", "to commands", "on average", "a tick", "the test"]
    print()
    print(table([*heads, *counts], rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
