"""A built bridge to DDS on loopback, its channels, and messages of a peer on PyPI's `cyclonedds`.

Purpose: what the tests of an exchange start, read and send. Non-goals: what is tested.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import shutil
import signal
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bench.ros.dds_peers import LOOPBACK

import processes
from generators.channel_programs import Outside

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

DOMAIN = os.getpid() % 200 + 1
"""One for each process of the tests: they do not hear each other."""
ENVIRONMENT = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN), "CYCLONEDDS_URI": LOOPBACK}


def missing() -> str:
    """What a machine lacks to compile a package; "": nothing."""
    for program in ("idlc", "make", "pkg-config", "cc"):
        if shutil.which(program) is None:
            return f"{program} is not installed"
    told = processes.run(["pkg-config", "--exists", "CycloneDDS"])
    return "" if told.returncode == 0 else "Cyclone DDS is not installed: cyclonedds-dev"


def compiled(package: Path) -> None:
    """Build it, and a library of its channels beside it."""
    done = processes.run(["make", "-C", str(package)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr, done.stderr
    trusted = package / "trusted"
    names = ("soter_outside.c", "soter_channel.c", "soter_posix_check.c")
    words: list[str | Path] = [
        "cc",
        "-shared",
        "-fPIC",
        "-std=gnu99",
        "-I",
        trusted,
        *(trusted / n for n in names),
    ]
    done = processes.run([*words, "-o", package / "channels.so"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------- channels


class Channel:
    """A channel of a package, by name; `size` as its C has it, `row`: before its hash, there."""

    def __init__(
        self, package: Path, folder: Path, name: str, size: int, *, writes: bool, row: str = ""
    ) -> None:
        source = next((package / "src").glob("*_bridge.c"))
        texts = [p.read_text("utf-8") for p in (package / "src").glob("*_bridge.c")]
        found = re.search((row or rf'\{{"{name}", ') + r"UINT64_C\((\w+)\)", "".join(texts))
        assert found is not None, source
        self.library = ctypes.CDLL(str(package / "channels.so"))
        self.library.soter_outside_open.restype = ctypes.c_char_p
        self.library.soter_outside_read.restype = ctypes.c_bool
        self.size = size
        self.outside = Outside()
        hash_ = ctypes.c_uint64(int(found[1], 16))
        wrong = self.library.soter_outside_open(
            ctypes.byref(self.outside), str(folder).encode(), name.encode(), hash_,
            ctypes.c_size_t(size), ctypes.c_bool(writes),
        )  # fmt: skip
        assert wrong is None, wrong

    def read(self) -> tuple[int, bytes] | None:
        """The newest value that was not read before, and its time."""
        at, room = ctypes.c_int64(), ctypes.create_string_buffer(self.size)
        there = self.library.soter_outside_read(
            ctypes.byref(self.outside), ctypes.byref(at), room, None
        )
        return (at.value, room.raw) if there else None

    def write(self, at: int, value: bytes) -> None:
        """A value, measured or made at a time of CLOCK_MONOTONIC."""
        room = ctypes.create_string_buffer(value, self.size)
        self.library.soter_outside_write(ctypes.byref(self.outside), ctypes.c_int64(at), room)

    def next(self, bridge: Bridge) -> tuple[int, bytes]:
        """The next value, while a bridge runs."""
        got: list[tuple[int, bytes]] = []

        def there() -> bool:
            value = self.read()
            got.extend([value] if value is not None else [])
            return bool(got)

        processes.until(there, bridge.process)
        return got[0]


# ---------------------------------------------------------------- the bridge


class Bridge:
    """A bridge that runs; what it says on standard error goes to a file."""

    def __init__(self, process: processes.Process, said: Path) -> None:
        self.process = process
        self._said = said

    @property
    def said(self) -> str:
        return self._said.read_text("utf-8")

    def wait_for(self, text: str) -> None:
        """Until it says so."""
        processes.until(lambda: text in self.said, self.process)

    def end(self) -> dict[str, Any]:
        """What it counted, by topic."""
        self.process.send_signal(signal.SIGTERM)
        out, _ = self.process.communicate(timeout=processes.TIMEOUT_S)
        assert self.process.returncode == 0, self.said
        return {t["topic"]: t for t in json.loads(out)["topics"]}


@contextmanager
def bridge(package: Path, folder: Path, *more: str) -> Iterator[Bridge]:
    """Started over the channels of a folder; it runs."""
    program = next((package / "build").glob("*_bridge"))
    said = folder / "said"
    words: list[str | Path] = [program, "--channels", folder, "--status", "json", *more]
    with (
        said.open("w") as errors,
        processes.started(
            words, env=ENVIRONMENT, stdout=processes.PIPE, stderr=errors, text=True
        ) as process,
    ):
        made = Bridge(process, said)
        made.wait_for("it runs")
        yield made


def floats(*numbers: float) -> bytes:
    """As C has them."""
    return struct.pack(f"<{len(numbers)}d", *numbers)
