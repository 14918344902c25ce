"""Channels that are torn, foreign, of another size, written by two, or by somebody who died."""

from __future__ import annotations

import signal
import struct
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
from soter.diagnostics.diagnostic import SoterError
from soter.remote.channel import Channel

if TYPE_CHECKING:
    from collections.abc import Callable

NUMBER, OTHER = 0x1122334455667788, 0x99
SIZE = 12
A, B, C = (letter * SIZE for letter in (b"a", b"b", b"c"))
PLACE = 128
"""Bytes of a place: a head of 64, then two words, rounded up to lines."""
BELL = 64
REFUSED = "it has a writer already; end that one first"
WRITER = """
import sys
from pathlib import Path
from soter.remote.channel import Channel

channel = Channel(Path(sys.argv[1]), "wish", int(sys.argv[2]), 12, writes=True)
channel.write(1, b"x" * 12)
print("written", flush=True)
sys.stdin.read()
"""

OPENS = """
import sys
from soter.remote.channel import compiled_library

ffi, lib = compiled_library()
channel = ffi.new("soter_outside *")
wrong = lib.soter_outside_open(channel, sys.argv[1].encode(), b"wish", 1, 12, True)
print("open" if wrong == ffi.NULL else ffi.string(wrong).decode())
"""
FORKS = """
import os
import signal
import sys
from pathlib import Path
from soter.remote.channel import Channel

folder, number = Path(sys.argv[1]), int(sys.argv[2])
channel = Channel(folder, "wish", number, 12, writes=True)
reads = Channel(folder, "wish", number, 12, writes=False)
if os.fork() != 0:
    signal.pause()
try:
    channel.write(1, b"x" * 12)
except ValueError as error:
    print(f"the child: {str(error).partition(':')[0]}", flush=True)
while (value := reads.read()) is None:
    reads.wait(10**18)
print(f"the child reads {value}", flush=True)
"""
PIPES = {"stdin": processes.PIPE, "stdout": processes.PIPE, "text": True}


def reader(folder: Path, number: int = NUMBER, size: int = SIZE) -> Channel:
    return Channel(folder, "wish", number, size, writes=False)


def writer(folder: Path, number: int = NUMBER) -> Channel:
    return Channel(folder, "wish", number, SIZE, writes=True)


def told(call: Callable[[], object]) -> str:
    with pytest.raises(SoterError) as caught:
        call()
    (problem,) = caught.value.diagnostics
    assert problem.code == "X013"
    return problem.message


def test_a_value_is_read_once_and_the_newest_wins(folder: Path) -> None:
    there, here = writer(folder), reader(folder)
    assert here.read() is None
    there.write(5, A)
    assert here.read() == (5, A)
    assert here.read() is None
    for stamp, image in ((6, B), (7, C), (8, A)):
        there.write(stamp, image)
    assert here.read() == (8, A)


def test_a_reader_that_waits_is_woken_and_needs_not_wait_for_what_is_there(folder: Path) -> None:
    there, here = writer(folder), reader(folder)
    there.write(5, A)
    here.wait(600 * 10**9)  # comes back: something is there
    assert here.read() == (5, A)


def test_a_torn_value_leaves_the_one_before(folder: Path) -> None:
    there = writer(folder)
    there.write(5, A)
    there.write(6, B)
    place = PLACE * (2 % 2)  # of value 2
    with (folder / "wish").open("r+b") as file:
        file.seek(place)
        (sequence,) = struct.unpack("<Q", file.read(8))
        file.seek(place)
        file.write(struct.pack("<Q", sequence + 1))  # in the middle of the next
    assert reader(folder).read() == (5, A)


@pytest.mark.parametrize("at", [16, 24, 32, 40, 48, 56, 64, 72])
def test_a_scribbled_value_leaves_the_one_before(folder: Path, at: int) -> None:
    there = writer(folder)
    there.write(5, A)
    there.write(6, B)
    with (folder / "wish").open("r+b") as file:
        file.seek(at)
        byte = file.read(1)
        file.seek(at)
        file.write(bytes([byte[0] ^ 1]))
    assert reader(folder).read() == (5, A)


def test_a_channel_of_another_size_is_told(folder: Path) -> None:
    writer(folder).write(5, A)
    message = told(lambda: reader(folder, size=100))
    assert "the channel `wish` cannot be used: it is of another layout" in message


@pytest.mark.parametrize("writes", [False, True])
def test_values_of_another_program_are_told_with_what_to_do(folder: Path, writes: bool) -> None:
    there = writer(folder, OTHER)
    there.write(5, A)
    there.close()
    message = told(lambda: Channel(folder, "wish", NUMBER, SIZE, writes=writes))
    assert "who wrote them was built from another program" in message
    assert "Connect with the robot's own package" in message


def test_a_writer_of_another_program_that_comes_later_is_told(folder: Path) -> None:
    here = reader(folder)
    assert here.read() is None
    there = writer(folder, OTHER)
    there.write(5, A)
    assert "built from another program" in told(here.read)


def test_the_second_writer_is_told(folder: Path) -> None:
    there = writer(folder)
    there.write(5, A)
    assert REFUSED in told(lambda: writer(folder))
    there.close()
    writer(folder).write(6, B)
    assert reader(folder).read() == (6, B)


def test_a_writer_that_was_killed_is_followed_by_another(folder: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(folder), str(NUMBER)]
    here = reader(folder)
    for _ in range(3):
        with processes.started(command, **PIPES) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "written\n"
            assert here.read() == (1, b"x" * 12), "its number is the next, not the first"
            assert REFUSED in told(lambda: writer(folder))
            process.send_signal(signal.SIGKILL)
            process.wait()
    own = writer(folder)
    own.write(9, B)
    assert here.read() == (9, B)


def test_a_writer_that_also_reads_keeps_its_lock(folder: Path) -> None:
    """Seen by a writer that is no Python: the lock is C's, and it is of the open file."""
    there = writer(folder)
    there.write(5, A)
    here = reader(folder)
    assert here.read() == (5, A)
    here.close()
    with processes.started([sys.executable, "-c", OPENS, str(folder)], **PIPES) as process:
        said, _ = process.communicate()
    assert said == f"{REFUSED}\n"
    there.close()
    with processes.started([sys.executable, "-c", OPENS, str(folder)], **PIPES) as process:
        said, _ = process.communicate()
    assert said == "open\n"


def test_a_killed_writer_is_followed_though_what_it_forked_lives(folder: Path) -> None:
    """The child reads on, and neither writes nor keeps its parent's lock."""
    command = [sys.executable, "-c", FORKS, str(folder), str(NUMBER)]
    with processes.started(command, **PIPES) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "the child: the connection is closed\n"
        assert REFUSED in told(lambda: writer(folder))
        process.send_signal(signal.SIGKILL)
        process.wait()
        own = writer(folder)
        own.write(9, B)
        assert process.stdout.readline() == f"the child reads {(9, B)}\n"


def test_what_is_closed_is_neither_read_nor_written(folder: Path) -> None:
    there = writer(folder)
    there.close()
    there.close()
    with pytest.raises(ValueError, match="the connection is closed"):
        there.write(5, A)
    with pytest.raises(ValueError, match="the connection is closed"):
        there.read()
    with pytest.raises(ValueError, match="the connection is closed"):
        there.wait(1)


def test_a_closed_channel_gives_its_memory_back(folder: Path) -> None:
    def mapped() -> int:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8")
        return maps.count(str(folder))

    channels = [writer(folder), *(reader(folder) for _ in range(5))]
    assert mapped() >= 1
    for channel in channels:
        channel.close()
    assert mapped() == 0


@pytest.mark.parametrize("what", ["folder", "link", "gone"])
def test_what_is_no_file_is_told(folder: Path, what: str) -> None:
    if what == "folder":
        (folder / "wish").mkdir()
    elif what == "link":
        (folder / "wish").symlink_to(folder / "elsewhere")
    else:
        folder.rmdir()
    assert "the channel `wish` cannot be used" in told(lambda: writer(folder))


def test_the_file_is_two_places_and_a_bell(folder: Path) -> None:
    writer(folder)
    assert (folder / "wish").stat().st_size == 2 * PLACE + BELL
