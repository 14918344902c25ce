"""Board files: what they say, and what is refused, in words and by how much."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.native.stack_bound import StackBound
from soter.targets.cortex_m_board import BOARDS, board_names, parsed_board, read_board
from soter.targets.cortex_m_image import build_image, missing_tool, require_enough_stack
from soter.targets.cortex_m_package import linker_script
from tables import all_rows

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
TEXT = (BOARDS / "mps2_an500.c").read_text(encoding="utf-8")


def changed(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


def refused(text: str) -> str:
    with pytest.raises(SoterError) as caught:
        parsed_board("mine", text)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "X017"
    return " ".join((diagnostic.message, *diagnostic.notes))


def test_every_board_that_ships_can_be_read() -> None:
    assert set(board_names()) >= {"mps2-an386", "mps2-an500", "netduinoplus2"}
    for name in board_names():
        board = read_board(name)
        placed = f"ORIGIN = {board.flash_at:#x}, LENGTH = {board.flash_bytes}"
        assert placed in linker_script(board, 512)


def test_nothing_else_knows_a_board() -> None:
    source = ROOT / "src" / "soter"
    texts = [p for p in (*source.rglob("*.py"), *source.rglob("*.[ch]")) if BOARDS not in p.parents]
    for name in board_names():
        knowing = [p for p in texts if name in p.read_text(encoding="utf-8")]
        assert knowing == [], name


@all_rows(
    ("old", "new", "words"),
    [
        (
            "#define BOARD_RAM_AT 0x20000000",
            "#define BOARD_RAM_AT 0x3ff000",
            "overlap: 4,096 bytes",
        ),
        ("#define BOARD_RAM_AT 0x20000000", "", "BOARD_RAM_AT ...` is not there"),
        ("BOARD_FLASH_BYTES 4194304", "BOARD_FLASH_BYTES 0", "flash of 0 bytes"),
        ("BOARD_RAM_AT 0x20000000", "BOARD_RAM_AT 0xfffff000", "beyond 4 GiB"),
        ("BOARD_RAM_BYTES 4194304", "BOARD_RAM_BYTES 4194301", "multiple of 8 bytes"),
        ("BOARD_STACK_BYTES 131072", "BOARD_STACK_BYTES 8388608", "a stack of 8,388,608 bytes"),
        ("BOARD_CLOCK_HZ 25000000", "BOARD_CLOCK_HZ 0", "`BOARD_CLOCK_HZ` is 0"),
        ('"cortex-m7"', '"cortex-m9"', "`BOARD_CORE` has to be one of"),
        ("void soter_board_watchdog(void) {}", "", "`soter_board_watchdog` is not defined"),
        ("BOARD_CLOCK_HZ 25000000", "BOARD_CLOCK_HZ 025000000", "or no number such as"),
        ("BOARD_CLOCK_HZ 25000000", "BOARD_CLOCK_HZ -5", "or no number such as"),
        ("BOARD_CLOCK_HZ 25000000", "BOARD_CLOCK_HZ 25000000U", "or no number such as"),
        ("BOARD_CLOCK_HZ 25000000", f"BOARD_CLOCK_HZ {'9' * 5000}", "or no number such as"),
        ("BOARD_CLOCK_HZ 25000000", "BOARD_CLOCK_HZ 4294967296", "no word of 32 bits"),
        ("BOARD_AC_BYTES 8192", "BOARD_AC_BYTES 8388608", "more than RAM"),
        ('"mps2-an500"', "mps2-an500", "`BOARD_QEMU` is no word in quotes"),
        ('"mps2-an500"', '"mps2-an500; ls"', "no name of a machine"),
        (
            "#define BOARD_RAM_AT 0x20000000",
            "#define BOARD_RAM_AT 0x20000000\n#define BOARD_RAM_AT 0x60000000",
            "`BOARD_RAM_AT` is defined twice",
        ),
    ],
)
def test_a_board_that_cannot_be_is_refused(old: str, new: str, words: str) -> None:
    assert words in refused(changed(old, new))


def test_numbers_may_stand_in_a_column() -> None:
    spread = TEXT.replace("#define BOARD_CORE ", "#define BOARD_CORE     ")
    spread = spread.replace("#define BOARD_RAM_AT ", "# define\tBOARD_RAM_AT\t")
    assert spread != TEXT
    assert parsed_board("mine", spread).ram_at == parsed_board("mine", TEXT).ram_at


def test_all_that_is_wrong_is_told_at_once() -> None:
    told = refused("")
    assert "BOARD_FLASH_AT" in told
    assert "soter_board_sense" in told


@pytest.mark.parametrize("given", ["mps2-an501", "nowhere.c"])
def test_a_board_that_is_not_there_is_refused(given: str) -> None:
    with pytest.raises(SoterError) as caught:
        read_board(given)
    assert caught.value.diagnostics[0].code == "X017"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "BOARD_FLASH_BYTES 4194304",
            "BOARD_FLASH_BYTES 8192",
            "bytes too many for flash of 8,192",
        ),
        ("BOARD_RAM_BYTES 4194304", "BOARD_RAM_BYTES 131080", "bytes too many for RAM of 131,080"),
    ],
)
def test_a_program_that_does_not_fit_says_by_how_much(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "small.c"
    file.write_text(changed(old, new), encoding="utf-8")
    board = read_board(str(file))
    if missing_tool(board):
        pytest.skip(missing_tool(board))
    package = soter.load(CART).build("cortex-m", tmp_path / "out", board=str(file))
    with pytest.raises(SoterError) as caught:
        build_image(package, board)
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "X015"
    assert words in diagnostic.message
    assert "largest: `" in diagnostic.notes[0]


def test_what_is_too_small_for_an_extern_is_named(tmp_path: Path) -> None:
    board = read_board("mps2-an500")
    if missing_tool(board):
        pytest.skip(missing_tool(board))
    one = TWO.replace("extern node Camera period 10ms { publishes seen; failsafe seen = 0.0; }", "")
    (tmp_path / "one.soter").write_text(one.replace("node Camera;", ""), encoding="utf-8")
    (tmp_path / "fast.c").write_text(
        '#include "one.h"\nstatic volatile char large[6000];\n'
        "int fast(const one_M_Fast_in* in, one_M_Fast_out* out) {\n"
        "  (void)in;\n  (void)out;\n  return large[0];\n}\n",
        encoding="utf-8",
    )
    program = soter.load(tmp_path / "one.soter")
    program.bind("M.Fast", f"c:{tmp_path / 'fast.c'}:fast")
    package = program.build("cortex-m", tmp_path / "out", board=board.name)
    with pytest.raises(SoterError) as caught:
        build_image(package, board)
    assert any("BOARD_AC_BYTES is too small" in x for x in caught.value.diagnostics[0].notes)


def test_a_stack_that_is_too_small_says_by_how_much() -> None:
    board = read_board("mps2-an500")
    require_enough_stack(StackBound(board.stack_bytes, way=("soter_instant",)), board)
    with pytest.raises(SoterError) as caught:
        require_enough_stack(
            StackBound(board.stack_bytes + 24, way=("soter_instant", "step")), board
        )
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == "X015"
    assert "24 bytes too many for its stack" in diagnostic.message
    assert diagnostic.notes == ("131,096 bytes: soter_instant > step",)


TWO = """soter 1;
topic pos: float in [-9.0, 9.0] max_age 100ms;
topic u: float in [-1.0, 1.0] = 0.0;
topic seen: float;
extern node Fast period 10ms { subscribes pos; publishes u; }
node Slow period 10ms { publishes u; step { publish u = 0.0; } }
extern node Camera period 10ms { publishes seen; failsafe seen = 0.0; }
rta M { ac Fast; sc Slow; period 50ms; safe true; ttf pos > 1.0; safer pos < 0.0; }
plant P period 10ms { reads u; drives pos = x; state x: float = 0.0; der x = u; }
system S { p: P; module M; node Camera; until 1s; }
"""


def notes_of(text: str, board: str, folder: Path) -> str:
    folder.mkdir(exist_ok=True)
    (folder / "two.soter").write_text(text, encoding="utf-8")
    return " ".join(soter.load(folder / "two.soter").build("cortex-m", folder, board=board).notes)


def test_two_extern_nodes_have_no_loop_and_the_build_names_them(tmp_path: Path) -> None:
    one = TWO.replace("extern node Camera period 10ms { publishes seen; failsafe seen = 0.0; }", "")
    one = one.replace("node Camera;", "")
    assert "no image for real time" not in notes_of(one, "mps2-an500", tmp_path)
    told = notes_of(TWO, "mps2-an500", tmp_path / "both")
    assert "no image for real time: `M.Fast`, `Camera` are extern nodes" in told


def test_a_core_without_an_mpu_says_that_nothing_contains_an_extern(tmp_path: Path) -> None:
    assert "guards no memory: C of `M.Fast`" in notes_of(TWO, "microbit", tmp_path)
    assert "guards no memory" not in notes_of(TWO, "mps2-an500", tmp_path / "other")


def fake_compiler(folder: Path, version: str) -> None:
    path = folder / "arm-none-eabi-gcc"
    path.write_text(f"#!/bin/sh\necho 'arm-none-eabi-gcc (GNU) {version}'\n", encoding="utf-8")
    path.chmod(0o755)


def test_without_tools_there_is_a_package_and_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in ("make", "sh", "cc"):
        found = shutil.which(name)
        if found is None:
            pytest.skip(f"there is no `{name}`")
        (tools / name).symlink_to(found)
    package = soter.load(CART).build("cortex-m", tmp_path / "out", board="mps2-an500")
    assert (package.folder / "soter_image.ld").is_file()
    monkeypatch.setenv("PATH", str(tools))
    board = read_board("mps2-an500")
    assert "there is no `arm-none-eabi-gcc`" in build_image(package, board).why
    fake_compiler(tools, "4.9.3 20150529")
    assert "is too old: arm-none-eabi-gcc (GNU) 4.9.3" in build_image(package, board).why
    fake_compiler(tools, "13.2.0")
    assert missing_tool(board) == ""
    assert os.environ["PATH"] == str(tools)
