"""Whether the generated C of campaigns compiles as device code, and is the same program then.

    .venv/bin/python bench/device/device_code.py [--flights N] [--arch 90] [--keep DIR]

Units of a small and of a large system are written as one file (`translation.py`, which says
what is changed). NVRTC compiles it with every function on the device, a world a thread, without
contraction of products and sums; ptxas says what a thread needs. The very same file is compiled by
g++ and flown on the CPU, lane by lane: digests, looks and saves against those of a campaign. No
device is needed, and none is asked for; where NVRTC (pip install nvidia-cuda-nvrtc) or ptxas are
not there, that is said. Exit code 1 where a file does not compile or a digest differs.
"""

from __future__ import annotations

import argparse
import ctypes
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.campaign.batch_flights import EPISODE_NS, EVENT, LOOK, Fleet
from soter.campaign.compiled_unit import generate_measured
from soter.language.front_end import check_file, system_of

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.device.translation import translated  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from soter.campaign.flight_outcome import FlightOutcome

SECOND = 10**9
SEED = 1
ROOM = 4096
"""Events of a flight."""
STATES = 4
"""Of a flight that goes alone: its own, and three to work in."""
UNITS = (
    ("examples/wall/cart.soter", 30 * SECOND, 0),
    ("examples/drone/campaign.soter", 600 * SECOND, 0),
    ("examples/drone/campaign.soter", 600 * SECOND, 10 * SECOND),
)
"""Program, length of a flight, horizon of saves."""
FLAGS = ("-std=c++20", "-O3", "-ffp-contract=off", "-fPIC", "-shared")
DEVICE = ("--std=c++20", "--fmad=false", "--device-as-default-execution-space")
HOURS = 104


class Lanes(ctypes.Structure):
    """`soter_lanes`."""

    _fields_ = (
        ("first_seed", ctypes.c_uint64),
        ("until_ns", ctypes.c_int64),
        ("horizon_ns", ctypes.c_int64),
        ("episode_ns", ctypes.c_int64),
        ("room", ctypes.c_uint64),
        *(
            (name, ctypes.c_void_p)
            for name in ("states", "events", "looks", "histogram", "saves", "precautions")
        ),
        ("flights", ctypes.c_void_p),
        ("done", ctypes.c_void_p),
    )


FLOWN = np.dtype(
    [("seed", "<u8"), ("events", "<u4"), ("digest", "S65"), ("trajectory", "S65"), ("_", "V2")]
)
"""`soter_flight`."""


def nvrtc() -> Any:  # noqa: ANN401 - a C library
    """NVRTC, of a package of this Python or of the system; None where there is none."""
    own = Path(sysconfig.get_paths()["purelib"]) / "nvidia"
    places = [*own.glob("*/lib/libnvrtc.so*"), *Path("/usr/local/cuda/lib64").glob("libnvrtc.so*")]
    for place in [*map(str, places), "libnvrtc.so"]:
        for beside in Path(place).parent.glob("libnvrtc-builtins.so*"):
            ctypes.CDLL(str(beside))  # NVRTC asks for it by its name alone
        try:
            return ctypes.CDLL(place)
        except OSError:
            continue
    return None


def text_of(lib: Any, program: Any, what: str) -> bytes:  # noqa: ANN401 - C
    """The log, or the PTX, of a program."""
    size = ctypes.c_size_t()
    getattr(lib, f"nvrtcGet{what}Size")(program, ctypes.byref(size))
    room = ctypes.create_string_buffer(size.value)
    getattr(lib, f"nvrtcGet{what}")(program, room)
    return room.value


def ptx_of(lib: Any, text: str, arch: str) -> tuple[bytes, str]:  # noqa: ANN401 - C
    """The PTX, empty where it does not compile, and what the compiler says."""
    program = ctypes.c_void_p()
    lib.nvrtcCreateProgram(ctypes.byref(program), text.encode(), b"unit.cu", 0, None, None)
    options = [o.encode() for o in (*DEVICE, f"--gpu-architecture=compute_{arch}")]
    code = lib.nvrtcCompileProgram(
        program, len(options), (ctypes.c_char_p * len(options))(*options)
    )
    log = text_of(lib, program, "ProgramLog").decode()
    return (b"" if code else text_of(lib, program, "PTX")), log


def assembled(ptx: bytes, arch: str, folder: Path) -> str:
    """What a thread needs, in words of ptxas."""
    ptxas = shutil.which("ptxas")
    if ptxas is None:
        return "ptxas is not there"
    (folder / "unit.ptx").write_bytes(ptx)
    command = [ptxas, "-v", f"-arch=sm_{arch}", "--fmad=false", "-o", "unit.cubin", "unit.ptx"]
    began = time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"ptxas refuses: {done.stderr.strip()[:400]}"
    wall = time.perf_counter() - began
    size = (folder / "unit.cubin").stat().st_size
    return f"{needs(done.stderr)}; cubin {size:,} bytes, {wall:.0f} s"


def needs(said: str) -> str:
    """What ptxas -v says of the kernel and of the functions that are called by pointer."""
    kernel = re.search(r"soter_fly_lanes\n\s*(.*?)\n.*?(Used \d+ registers)(.*)", said)
    frames = re.findall(r"Function properties for (\S+)\n\s*(\d+) bytes stack frame", said)
    spilled = sum(int(x) for x in re.findall(r"(\d+) bytes spill stores", said))
    whole = re.search(r"(\d+) bytes cumulative stack size", said)
    if kernel is None or whole is None:
        return f"ptxas says {said[:400]}"
    name, most = max(frames, key=lambda f: int(f[1]))
    short = re.sub(r"^_ZN\d+_INTERNAL_\w*?_unit_cu_[0-9a-f]{8}\d+|E[PvKjlxyhdb_]*$", "", name)
    return (
        f"ptxas: {kernel[2].lower()}, {int(whole[1]):,} bytes of stack a thread "
        f"(largest frame {int(most):,}: {short}), {spilled:,} bytes spilled"
    )


def lanes_of(text: str, fleet: Fleet, count: int, folder: Path) -> tuple[list[Any], float]:
    """Flights of the file on the CPU: (digest, looks, saves, precautions) of each, and how long."""
    source, built = folder / "unit.cpp", folder / "unit.so"
    source.write_text(text, encoding="utf-8")
    subprocess.run(["g++", *FLAGS, "-w", "-o", str(built), str(source)], check=True)
    recipe, size = fleet.recipe, fleet.dtype.itemsize
    modules = len(recipe.forced)
    arrays = {
        "states": np.zeros((count, STATES, size), dtype=np.uint8),
        "events": np.zeros((count, ROOM), dtype=EVENT),
        "looks": np.zeros((count, len(recipe.bins)), dtype=LOOK),
        "histogram": np.zeros((count, sum(recipe.bins)), dtype=np.uint32),
        "saves": np.zeros((count, modules), dtype=np.uint32),
        "precautions": np.zeros((count, modules), dtype=np.uint32),
        "flights": np.zeros(count, dtype=FLOWN),
        "done": np.zeros(count, dtype=np.uint32),
    }
    times = (recipe.until_ns, recipe.horizon_ns, EPISODE_NS)
    given = Lanes(SEED, *times, ROOM, *(a.ctypes.data for a in arrays.values()))
    began = time.perf_counter()
    ctypes.CDLL(str(built)).soter_fly_lanes(ctypes.byref(given), count)
    wall = time.perf_counter() - began
    counted = bool(recipe.horizon_ns)
    lanes = [
        (
            (flight["digest"].decode(), flight["trajectory"].decode()),
            [(*look.tolist(),) for look in arrays["looks"][k][["count", "sum", "least", "most"]]],
            tuple(arrays["saves"][k].tolist()) if counted else (),
            tuple(arrays["precautions"][k].tolist()) if counted else (),
        )
        for k, flight in enumerate(arrays["flights"])
        if arrays["done"][k]
    ]
    return lanes, wall


def said_of(flight: FlightOutcome) -> Any:  # noqa: ANN401 - a row
    """The same of a flight of a campaign."""
    looks = [(x.count, x.sum, x.least, x.most) for x in flight.looks]
    return (flight.digest, flight.trajectory), looks, flight.saves, flight.precautions


def device(text: str, arch: str, folder: Path) -> bool:
    """Compile for the device, and say it."""
    lib = nvrtc()
    if lib is None:
        print("  device: not compiled, NVRTC is not there (pip install nvidia-cuda-nvrtc)")
        return True
    version = (ctypes.c_int(), ctypes.c_int())
    lib.nvrtcVersion(ctypes.byref(version[0]), ctypes.byref(version[1]))
    began = time.perf_counter()
    ptx, log = ptx_of(lib, text, arch)
    wall = time.perf_counter() - began
    name = f"NVRTC {version[0].value}.{version[1].value}, compute_{arch}"
    print(f"  device: {name}, {' '.join(DEVICE)}")
    if not ptx:
        errors = [x for x in log.splitlines() if "error" in x]
        print(f"  device: does not compile, {len(errors)} errors; {' | '.join(errors[:5])}")
        return False
    indirect = len(re.findall(rb"^\s*(?:\(.*\),?\s*)?%\w+,$", ptx, re.MULTILINE))
    calls = ptx.count(b".callprototype") or indirect
    fused = len(re.findall(rb"\b(?:fma|mad)\.\w+\.f64|\.approx\b|\.ftz\b", ptx))
    warned = sum("warning" in x for x in log.splitlines())
    print(
        f"  device: compiles in {wall:.1f} s, {warned} warnings; PTX {len(ptx):,} bytes, "
        f"{calls} calls by pointer, {fused} fused or rough operations"
    )
    print(f"  device: {assembled(ptx, arch, folder)}")
    return not fused


def one(path: str, until_ns: int, horizon_ns: int, args: argparse.Namespace, folder: Path) -> bool:
    """One unit."""
    system = system_of(check_file(str(ROOT / path)), None)
    fleet = Fleet(system, until_ns, horizon_ns=horizon_ns)
    text = translated(generate_measured(system, remembers=False))
    if args.keep:
        args.keep.mkdir(parents=True, exist_ok=True)
        (args.keep / f"{fleet.recipe.unit.prefix}.cu").write_text(text, encoding="utf-8")
    saves = f", saves over {horizon_ns / SECOND:g} s" if horizon_ns else ""
    print(f"{path}: system {system.name}, {until_ns / SECOND:g} s a flight{saves}")
    print(f"  file: {len(text):,} bytes, {len(text.splitlines()):,} lines of C++")
    right = True
    if not horizon_ns:
        right = device(text, args.arch, folder)
    size, measures = fleet.dtype.itemsize, fleet.recipe.bins
    flights = -(-HOURS * 3600 * SECOND // until_ns)
    out = 8 * len(measures) * 4 + 4 * sum(measures) + FLOWN.itemsize + 8 * len(fleet.recipe.forced)
    print(
        f"  memory: a lane {STATES * size + ROOM * EVENT.itemsize + out:,} bytes, of which "
        f"{out:,} and its events come back (the last state, {size:,}, is in the digest); in: one "
        f"seed; {HOURS} h are {flights:,} lanes"
    )
    began = time.perf_counter()
    wanted = [said_of(f) for f in fleet.fly(range(args.flights), SEED)]
    campaign_s = time.perf_counter() - began
    lanes, wall = lanes_of(text, fleet, args.flights, folder)
    same = lanes == wanted
    print(
        f"  CPU: {args.flights} flights of the same file by g++ ({wall:.2f} s; by the campaign "
        f"{campaign_s:.2f} s): {'the same' if same else 'OTHER'} digests, looks and saves"
    )
    return right and same


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--arch", default="90")
    parser.add_argument("--keep", type=Path, help="also leave the files here")
    args = parser.parse_args()
    right = True
    for path, until_ns, horizon_ns in UNITS:
        with tempfile.TemporaryDirectory() as folder:
            right = one(path, until_ns, horizon_ns, args, Path(folder)) and right
    print("No device was asked: digests and speed there are not known from this.")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
