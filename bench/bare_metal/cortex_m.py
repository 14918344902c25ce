"""What images for a Cortex-M take: flash, RAM, stack, and instructions under QEMU.

    .venv/bin/python bench/bare_metal/cortex_m.py

Purpose: issue 33's table. Examples with their plants in virtual time, whose trace has to be the
host's, and the trusted part alone in its time-triggered loop; what the test of the arithmetic and
the doubles take is told apart. Instructions are those of ten equal runs.
Non-goals: times. No hardware is asked: counts of an emulator are none.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import soter
from soter.api.deploying import image_of, stack_bound
from soter.report.terminal_tables import table
from soter.targets.cortex_m.board import read_board
from soter.targets.cortex_m.image import Image, build_image, missing_tools

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
BOARDS = ("mps2-an386", "mps2-an500")
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
TEST = re.compile(
    r"(soter_(arithmetic_is_right|self_test|computes|operation_name)|is_right|are_(compared_)?right|"
    r"(sums|products|roots|conversions)_are_right|nearest|right_of_\w+|here_of_\w+|sum_of|product_of|"
    r"quotient_of|root_of|raised|draw|hard_significand|with_exponent|normal|from_integer|"
    r"to_integer|floor_of|names)$"
)
DOUBLES = re.compile(r"__(aeabi_.*d|.*df|fix|float)|sqrt$|floor$")
RUNS = 10


def parts(image: Path) -> tuple[int, int]:
    """Bytes of code of the test of the arithmetic, and of doubles without hardware."""
    words = ["arm-none-eabi-nm", "--print-size", "--radix=d", str(image)]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    at = {}
    for line in said.splitlines():
        found = re.match(r"^(\d+) (\d+) [tTwW] (\S+)$", line)
        if found is not None:
            at[found[1]] = (int(found[2]), found[3].partition(".")[0])
    test = sum(size for size, name in at.values() if TEST.match(name))
    return test, sum(size for size, name in at.values() if DOUBLES.match(name))


def replayed(name: str, file: str, system: str | None, board: str) -> list[str]:
    """A row of an example with its plants."""
    with tempfile.TemporaryDirectory() as folder:
        package = soter.load(EXAMPLES / file).build(
            "cortex-m", Path(folder) / "out", system, board=board
        )
        stack = stack_bound(package, board)
        images = [image_of(package, board, stack) for _ in range(RUNS)]
    (image,) = set(images)
    assert image is not None
    if image.instant_most is None:
        return [name, board, *["-"] * 6, image.why]
    return [
        name,
        board,
        f"{image.flash:,}",
        f"{image.ram:,}",
        f"{stack.bytes:,}",
        f"{image.stack_used:,}",
        f"{image.instant_most:,}",
        f"{image.instant_mean:,}",
        "same" if image.same_as_host else "-",
    ]


def trusted(name: str, file: Path, board: str) -> list[str]:
    """A row of a trusted part: its loop's image, and the instants of its own run."""
    with tempfile.TemporaryDirectory() as folder:
        package = soter.load(file).build("cortex-m", Path(folder) / "out", board=board)
        run: Image = build_image(package, read_board(board))
        loop = package.image.replace(".elf", "_loop.elf")
        zig = f"ZIG={sys.executable} -m ziglang"
        subprocess.run(
            ["make", "-s", "-C", str(package.folder), loop, zig], check=True, capture_output=True
        )
        path = package.folder / loop
        words = ["arm-none-eabi-size", str(path)]
        said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        text, data, bss = (int(x) for x in said.splitlines()[1].split()[:3])
        test, doubles = parts(path)
    flash, ram = text + data, data + bss - read_board(board).stack_bytes
    return [
        name,
        board,
        f"{flash:,}",
        f"{test:,}",
        f"{doubles:,}",
        f"{flash - test - doubles:,}",
        f"{ram:,}",
        f"{run.instant_most:,}",
        f"{run.self_test:,}",
    ]


def main() -> int:
    """Print both tables."""
    for board in BOARDS:
        if missing_tools(read_board(board)):
            print(missing_tools(read_board(board)))
            return 1
    rows = [replayed(name, file, of, board) for name, file, of in WHOLE for board in BOARDS]
    heads = ["with its plants", "board", "flash", "RAM", "stack at most", "used"]
    print(table([*heads, "instructions", "on average", "trace"], rows))
    with tempfile.TemporaryDirectory() as folder:
        drone = Path(folder) / "vehicle.soter"
        drone.write_text(DRONE, encoding="utf-8")
        cart = EXAMPLES / "wall" / "cart_firmware.soter"
        rows = [trusted(n, f, b) for n, f in (("cart", cart), ("drone", drone)) for b in BOARDS]
    heads = ["trusted part", "board", "flash", "its test", "doubles", "the rest", "RAM"]
    print()
    print(table([*heads, "instructions", "of the test"], rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
