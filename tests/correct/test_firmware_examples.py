"""The firmware that users copy when its sensor dies, and the C of the pages."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import processes
import soter
from generators.c_packages import EXAMPLES, make
from soter.native.compiler import MEANING, WARNINGS, find_compiler

ROOT = Path(__file__).resolve().parents[2]
SHUTTLE = EXAMPLES / "wall" / "shuttle_firmware.soter"
OWN = EXAMPLES / "wall" / "firmware"
CPP = ("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror", "-std=c++17")
DEATHS_MS = tuple(137 + 291 * k for k in range(100))
"""When the sensor falls silent: on the way to the wall, and at it."""
C_BLOCK = re.compile(r"^```(?:c|cpp|c\+\+)\b[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMANDS = re.compile(r"_step\(&|_publish_\w+\(&|soter_grant_lease\(")
"""What a block of C does that passes commands on, or steps."""
AT_AN_ACTUATOR = re.compile(r"soter_lease_take\(")
WITHOUT = {
    "stale": ("SOTER_STALE | ", ""),
    "lease": (
        "soter_lease_read(&lease, now, &held) != obeys",
        "Vehicle_read_speed(&vehicle, &held.speed, NULL) != obeys",
    ),
}
"""What is taken out -> what of the text, and what stands there instead."""
PRELUDE = """
#include "Vehicle_firmware.h"
#include "shuttle_firmware_lease.h"
void send(const shuttle_firmware_Guard_command *c, int64_t stamp, int64_t expiry);
void page(int64_t origin, int64_t start, int64_t out, int64_t now);
void page(int64_t origin, int64_t start, int64_t out, int64_t now) {
static Vehicle vehicle;
shuttle_firmware_Guard_command command = {0.0};
int64_t stamp = 0, expiry = 0;
(void)vehicle; (void)origin; (void)start; (void)out; (void)now; (void)stamp; (void)expiry;
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of the shuttle in the world, and its library."""
    folder = tmp_path_factory.mktemp("firmware") / "shuttle_c"
    soter.load(SHUTTLE).build("c", folder)
    done = make(folder, "lib", f"CFLAGS=-O2 {' '.join(WARNINGS)}")
    assert done.returncode == 0, done.stderr
    return folder


def compiled(built: Path, name: str, text: str) -> Path:
    """A main of one's own with the library of the package."""
    (built / f"own_{name}").write_text(text)
    target = built / f"own_{name.replace('.', '_')}"
    c = [*find_compiler().command, "-std=c99", *MEANING, *WARNINGS]
    words = c if name.endswith(".c") else [shutil.which("g++") or "clang++", *CPP]
    library = str(built / "libshuttle_firmware.a")
    words += [f"-I{built}", str(built / f"own_{name}"), library, "-lm", "-pthread"]
    done = processes.run([*words, "-o", str(target)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def example(name: str) -> str:
    if name.endswith(".cpp") and not (shutil.which("g++") or shutil.which("clang++")):
        pytest.skip("no C++ compiler is here")
    return (OWN / name).read_text(encoding="utf-8")


def ends(own: Path) -> list[int]:
    """How it ends for each death of the sensor: 0 between the walls, 3 not."""
    return [processes.run([own, str(ms)], capture_output=True).returncode for ms in DEATHS_MS]


def test_the_firmware_keeps_the_shuttle_between_the_walls(built: Path) -> None:
    ran = processes.run([compiled(built, "main.c", example("main.c"))], capture_output=True)
    lines = ran.stdout.decode().splitlines()
    assert (ran.returncode, lines[0]) == (0, "0 ms: the drive obeys"), "and nothing else"
    (share,) = re.findall(r"AC had control in (\d+) of 24000 turns", lines[1])
    assert 1000 < int(share) < 23_000, "AC rushes at the wall and is stopped, again and again"
    assert len(lines) == 2


def test_the_clock_of_the_machine_is_obeyed(built: Path) -> None:
    ran = processes.run([compiled(built, "main.cpp", example("main.cpp"))], capture_output=True)
    assert ran.returncode == 0
    assert b"between the walls" in ran.stdout


LATE_NS, RESPONSE_NS = 200_000, 1_000_000
"""Of SC and of the DM: `late` and `response`."""


def package_of_little_lateness(folder: Path) -> Path:
    """The shuttle in the world, whose parts begin soon and may take longer than that."""
    folder.mkdir()
    for source in (SHUTTLE, SHUTTLE.with_name("shuttle.soter")):
        text = source.read_text(encoding="utf-8").replace(
            "late dm 1ms, sc 1ms", "late dm 200us, sc 200us"
        )
        (folder / source.name).write_text(text)
    soter.load(folder / SHUTTLE.name).build("c", folder / "out")
    done = make(folder / "out", "lib", f"CFLAGS=-O2 {' '.join(WARNINGS)}")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_a_step_that_takes_as_long_as_it_may_keeps_its_lease(tmp_path: Path) -> None:
    """It begins in time, and its output is out later than `late`, and inside of the response."""
    package = package_of_little_lateness(tmp_path / "tight")
    text, step = example("main.c"), "pass_on(Vehicle_step(&vehicle, now), now, now)"
    assert text.count(step) == 1
    for takes_ns, obeyed in ((LATE_NS + 1, True), (RESPONSE_NS, True), (RESPONSE_NS + 1, False)):
        slow = text.replace(step, f"{step[:-1]} + INT64_C({takes_ns}))")
        said = processes.run([compiled(package, f"after_{takes_ns}.c", slow)], capture_output=True)
        keeps = b"0 ms: the drive obeys" in said.stdout and b"holds the law" not in said.stdout
        assert keeps == obeyed, (takes_ns, said.stdout)


@pytest.mark.parametrize("name", ["main.c", "main.cpp"])
def test_the_sensor_dies_and_the_shuttle_stands_still(built: Path, name: str) -> None:
    own = compiled(built, name, example(name))
    assert ends(own) == [0] * len(DEATHS_MS)
    said = processes.run([own, "7300"], capture_output=True, text=True).stdout
    assert "holds the law" in said
    assert "farthest 7.325 m" in said, "it stands where the last lease ended"


@pytest.mark.parametrize(
    ("name", "without"), [("main.c", "stale"), ("main.c", "lease"), ("main.cpp", "stale")]
)
def test_firmware_that_does_not_obey_crashes(built: Path, name: str, without: str) -> None:
    """What the test above sees: each of the two is needed, at every one of the instants."""
    text = example(name)
    was, now = WITHOUT[without]
    assert text.count(was) == 1
    own = compiled(built, f"{without}_{name}", text.replace(was, now))
    assert ends(own) == [3] * len(DEATHS_MS)


def test_both_walls_count(built: Path) -> None:
    """Sensors that die beyond the middle drive SC to the wall behind it."""
    text = example("main.c").replace("SOTER_STALE | ", "")
    own = compiled(built, "one_wall.c", text.replace("fabs(x)", "x"))
    assert 0 in ends(own), "an eye for one wall only says success"


# ---------------------------------------------------------------- the pages


def blocks() -> list[tuple[str, str]]:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [(p.name, b) for p in pages for b in C_BLOCK.findall(p.read_text(encoding="utf-8"))]


def careless(code: str) -> bool:
    """Whether a block goes on with a step's outputs whatever the step said, or without a law."""
    if COMMANDS.search(code):
        return not re.search(r"if \([^;{]*\bSOTER_STALE\b", code)
    return bool(AT_AN_ACTUATOR.search(code)) and "soter_lease_read(" not in code


def test_every_c_block_of_the_pages_obeys_what_a_step_says() -> None:
    page_blocks = blocks()
    assert [page for page, code in page_blocks if careless(code)] == []
    acting = [code for _, code in page_blocks if COMMANDS.search(code)]
    assert acting, "the page of the firmware has one"
    assert all(careless(code.replace("SOTER_STALE | ", "")) for code in acting)


def test_the_c_blocks_of_the_firmware_page_compile(built: Path) -> None:
    code = "".join(code for page, code in blocks() if page == "deploy.md")
    assert "soter_lease_read" in code
    (built / "page.c").write_text(f"{PRELUDE}{code}}}\n")
    words = [*find_compiler().command, "-std=c99", *WARNINGS, "-Wno-unused-variable", f"-I{built}"]
    done = processes.run(
        [*words, "-c", str(built / "page.c"), "-o", str(built / "page.o")],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
