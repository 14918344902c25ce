"""Channels in files: whole values, whoever is killed when; who starts anew goes on."""

from __future__ import annotations

import ctypes
import os
import random
import signal
import struct
import sys
import threading
import time
from typing import TYPE_CHECKING

import pytest

import processes
from generators.channel_programs import Number, Outside, library
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

POSIX = RUNTIME / "posix"
KILLS = 40
BELL_BYTES = 64
FOR_EVER_NS = 10**18
WRITER = """\
#include "soter_outside.h"
int main(int count, char** words) {
  soter_outside channel;
  if (count < 2 || soter_outside_open(&channel, words[1], "many", 7, 400, true) != NULL) return 1;
  for (uint64_t n = channel.number + 1;; n++) {
    uint64_t value[50];
    for (uint64_t i = 0; i < 50; i++) value[i] = n * 1000 + i;
    soter_outside_write(&channel, (int64_t)n, value);
  }
}
"""
READER = """\
#include "soter_outside.h"
#include <stdio.h>
#include <stdlib.h>
/* Looks so often, and prints how many values were new, and how many were wrong or went back. */
int main(int count, char** words) {
  soter_outside channel;
  if (count < 3 || soter_outside_open(&channel, words[1], "many", 7, 400, false) != NULL) return 1;
  long fresh = 0, wrong = 0;
  int64_t last = 0;
  for (long k = atol(words[2]); k > 0; k--) {
    uint64_t value[50];
    int64_t n = 0;
    if (!soter_outside_read(&channel, &n, value, NULL)) continue;
    fresh++;
    wrong += n <= last;
    for (uint64_t i = 0; i < 50; i++) wrong += value[i] != (uint64_t)n * 1000 + i;
    last = n;
  }
  printf("%ld %ld\\n", fresh, wrong);
  return 0;
}
"""


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


def program(folder: Path, name: str, text: str, *more: str) -> Path:
    (folder / f"{name}.c").write_text(text)
    own = ("soter_outside.c", "soter_channel.c", "soter_posix_check.c")
    sources = [folder / f"{name}.c", *(POSIX / file for file in own)]
    flags = ["-std=c99", "-O2", "-fsanitize=address,undefined", f"-I{POSIX}", f"-I{RUNTIME}"]
    processes.run(["cc", *flags, *more, "-o", folder / name, *sources], check=True)
    return folder / name


def test_a_writer_that_is_killed_leaves_whole_values_and_the_next_goes_on(tmp_path: Path) -> None:
    """Two places: at no time there is nothing to be read, and nothing is older than before."""
    writer, reader = program(tmp_path, "w", WRITER), program(tmp_path, "r", READER)
    chance = random.Random(3)  # noqa: S311 - no secret
    channels = tmp_path / "channels"
    channels.mkdir()
    total = 0
    for kill in range(KILLS):
        with processes.started([writer, channels]) as process:
            path = channels / "many"
            while not path.exists() or path.read_bytes()[:8] == bytes(8):
                time.sleep(0.001)
            if kill % 10 == 0:
                beside = processes.run([reader, channels, "20000"], capture_output=True, text=True)
                fresh, wrong = (int(x) for x in beside.stdout.split())
                assert wrong == 0
                total += fresh
            time.sleep(chance.uniform(0.0, 0.01))
            os.kill(process.pid, signal.SIGKILL)
        after = processes.run([reader, channels, "3"], capture_output=True, text=True)
        assert after.stdout.split() == ["1", "0"], "one whole value is there"
    assert total >= KILLS // 10, "beside one that writes all the time"


ONE_VALUE = """\
#include "soter_outside.h"
#include <stdio.h>
int main(int count, char** words) {
  soter_outside channel;
  static const uint8_t value[40000];
  const char* wrong = "usage";
  if (count > 1) wrong = soter_outside_open(&channel, words[1], "x", 7, sizeof value, true);
  puts(wrong != NULL ? wrong : "open");
  if (wrong == NULL) soter_outside_write(&channel, 1, value);
  return wrong != NULL;
}
"""
SMALL = "mount -t tmpfs -o size=64k none {0} && {{ {1}; {2} {0}; }}"


@pytest.mark.parametrize("hole", [False, True])
def test_a_full_file_system_is_told_when_the_channel_is_opened(tmp_path: Path, hole: bool) -> None:
    """Not by the signal that ends whoever writes; nor where the file is there, and is a hole."""
    apart = ["unshare", "--user", "--map-root-user", "--mount"]
    if processes.run([*apart, "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("no mounts of our own here (user namespaces)")
    writer = program(tmp_path, "one", ONE_VALUE)
    plain = tmp_path / "plain"
    plain.mkdir()
    done = processes.run([writer, plain], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "open\n")
    before = f"truncate -s {(plain / 'x').stat().st_size} {{0}}/x" if hole else "true"
    full = tmp_path / "full"
    full.mkdir()
    told = SMALL.format(full, before.format(full), writer)
    done = processes.run([*apart, "sh", "-c", told], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done
    assert done.stdout == "there is no room for it: the file system of the folder is full\n"


def test_a_place_in_the_making_hides_nothing(code: ctypes.CDLL, tmp_path: Path) -> None:
    writer = Number(code, tmp_path, "x", 7, writes=True)
    writer.write(1.0)
    writer.write(2.0)
    data = bytearray((tmp_path / "x").read_bytes())
    half = (len(data) - BELL_BYTES) // 2
    newest = max((0, half), key=lambda at: struct.unpack_from("<Q", data, at + 24)[0])
    (sequence,) = struct.unpack_from("<Q", data, newest)
    struct.pack_into("<Q", data, newest, sequence | 1)
    (tmp_path / "x").write_bytes(data)
    assert Number(code, tmp_path, "x", 7, writes=False).read() == 1.0


def test_what_was_scribbled_is_not_read(code: ctypes.CDLL, tmp_path: Path) -> None:
    writer = Number(code, tmp_path, "x", 7, writes=True)
    for value in (1.0, 2.0):
        writer.write(value)
    data = bytearray((tmp_path / "x").read_bytes())
    whole = bytes(data)
    read = []
    for at in range(len(data)):
        data = bytearray(whole)
        data[at] ^= 0x10
        (tmp_path / "x").write_bytes(data)
        read.append(Number(code, tmp_path, "x", 7, writes=False).read())
    assert set(read) == {1.0, 2.0}, "the other place, or a byte that belongs to neither"
    assert read.count(1.0) >= 60, "every byte of the newest value counts"


def test_who_waits_is_woken_by_the_next_value(code: ctypes.CDLL, tmp_path: Path) -> None:
    """It would wait for thirty years, and a writer that comes later ends it."""
    reader = Number(code, tmp_path, "x", 7, writes=False)
    writer = Number(code, tmp_path, "x", 7, writes=True)
    waits = threading.Thread(target=reader.wait, args=(FOR_EVER_NS,), daemon=True)
    waits.start()
    bell = (tmp_path / "x").stat().st_size - BELL_BYTES
    while struct.unpack_from("<I", (tmp_path / "x").read_bytes(), bell + 4)[0] == 0:
        time.sleep(0.001)
    writer.write(1.0)
    waits.join(processes.TIMEOUT_S)
    assert not waits.is_alive()
    assert reader.read() == 1.0


def test_nobody_waits_for_what_is_there_or_for_longer_than_said(
    code: ctypes.CDLL, tmp_path: Path
) -> None:
    reader = Number(code, tmp_path, "x", 7, writes=False)
    writer = Number(code, tmp_path, "x", 7, writes=True)
    writer.write(1.0)
    reader.wait(FOR_EVER_NS)
    assert reader.read() == 1.0
    reader.wait(1_000_000)
    reader.read()
    assert reader.fresh is False


def test_a_reader_takes_every_value_once(code: ctypes.CDLL, tmp_path: Path) -> None:
    reader = Number(code, tmp_path, "x", 7, writes=False)
    assert reader.read() != reader.read(), "nobody wrote"
    Number(code, tmp_path, "x", 7, writes=True).write(1.0)
    assert reader.read() == 1.0
    again = Number(code, tmp_path, "x", 7, writes=True)
    again.write(2.0)
    assert reader.read() == 2.0
    assert reader.fresh is True
    reader.read()
    assert reader.fresh is False


@pytest.mark.parametrize("what", ["size", "link", "folder", "long"])
def test_what_is_no_channel_is_refused_in_words(
    code: ctypes.CDLL, tmp_path: Path, what: str
) -> None:
    name = "x" * 5000 if what == "long" else "x"
    if what == "size":
        (tmp_path / "x").write_bytes(b"!" * 100)
    elif what == "link":
        (tmp_path / "x").symlink_to("y")
    elif what == "folder":
        (tmp_path / "x").mkdir()
    assert Number(code, tmp_path, name, 7, writes=False).wrong
    if what == "size":
        assert (tmp_path / "x").read_bytes() == b"!" * 100


# ---------------------------------------------------------------- one writer

MAIN = """\
#define _GNU_SOURCE
#include "soter_outside.h"
#include <stdio.h>
#include <unistd.h>
static const char* to(soter_outside* channel, const char* folder, bool write) {
  const char* const wrong = soter_outside_open(channel, folder, "many", 7, 400, write);
  return wrong != NULL ? wrong : "open";
}
static void tell(const char* said) {
  puts(said);
  (void)fflush(stdout);
}
int main(int count, char** words) {
  soter_outside channel, other;
  if (count < 2) return 1;
  tell(to(&channel, words[1], true));
  ACT
}
"""
"""Opens the channel to write, says what came of it, and does what stands for ACT."""
AND_WAITS = "(void)getchar(); return 0;"
READS = f"tell(to(&other, words[1], false)); {AND_WAITS}"
WRITES_AGAIN = "tell(to(&other, words[1], true)); return 0;"
FORKS = """const pid_t child = fork();
  if (child == 0) {
    soter_outside_close(&channel);
    tell("left");
    for (;;) pause();
  }
  return getchar();"""
OF_PROCESSES = """
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <sys/syscall.h>
int fcntl_of_old(int file, int command, ...) {
  va_list more;
  va_start(more, command);
  void* const given = va_arg(more, void*);
  va_end(more);
  if (command == F_OFD_SETLK) errno = EINVAL;
  return command == F_OFD_SETLK ? -1 : (int)syscall(SYS_fcntl, file, command, given);
}
"""
"""A system that has no locks of open files, for who is compiled with -Dfcntl=fcntl_of_old."""
REFUSED = "it has a writer already; end that one first"


def lines_of(process: processes.Process, count: int) -> list[str]:
    """The next lines that it says."""
    assert process.stdout is not None
    return [process.stdout.readline().rstrip() for _ in range(count)]


def test_a_channel_has_one_writer_until_that_one_ends(code: ctypes.CDLL, tmp_path: Path) -> None:
    """A second trusted part, or a second actuator that was never armed, would speak in between."""
    writer = program(tmp_path, "w", WRITER)
    with processes.started([writer, tmp_path]) as process:
        while not (tmp_path / "many").exists() or not any((tmp_path / "many").read_bytes()[:8]):
            time.sleep(0.001)
        second = Outside()
        words = (str(tmp_path).encode(), b"many", ctypes.c_uint64(7), ctypes.c_size_t(400))

        def opened(writes: bool) -> bytes | None:
            wrong: bytes | None = code.soter_outside_open(
                ctypes.byref(second), *words, ctypes.c_bool(writes)
            )
            return wrong

        assert opened(True) == REFUSED.encode()
        assert opened(False) is None
        process.kill()
        process.wait()
        assert opened(True) is None


def test_a_writer_that_also_reads_keeps_its_lock(tmp_path: Path) -> None:
    """A POSIX lock goes with any of the process's files of that name that is closed."""
    first = program(tmp_path, "first", MAIN.replace("ACT", READS))
    second = program(tmp_path, "second", MAIN.replace("ACT", "return 0;"))
    pipes = {"stdin": processes.PIPE, "stdout": processes.PIPE, "text": True}
    with processes.started([first, tmp_path], **pipes) as process:
        assert lines_of(process, 2) == ["open", "open"]
        beside = processes.run([second, tmp_path], capture_output=True, text=True)
        assert beside.stdout == f"{REFUSED}\n"
    after = processes.run([second, tmp_path], capture_output=True, text=True)
    assert after.stdout == "open\n"


def test_a_second_writer_in_the_same_process_is_refused(tmp_path: Path) -> None:
    both = program(tmp_path, "both", MAIN.replace("ACT", WRITES_AGAIN))
    said = processes.run([both, tmp_path], capture_output=True, text=True).stdout
    assert said == f"open\n{REFUSED}\n"


def test_a_killed_writer_is_followed_though_what_it_forked_lives(tmp_path: Path) -> None:
    """Its child has left the channel: the lock is of the file that both have open."""
    first = program(tmp_path, "first", MAIN.replace("ACT", FORKS))
    second = program(tmp_path, "second", MAIN.replace("ACT", "return 0;"))
    pipes = {"stdin": processes.PIPE, "stdout": processes.PIPE, "text": True}
    with processes.started([first, tmp_path], **pipes) as process:
        assert lines_of(process, 2) == ["open", "left"]
        assert processes.run([second, tmp_path], capture_output=True, text=True).stdout == (
            f"{REFUSED}\n"
        )
        process.kill()
        process.wait()
        after = processes.run([second, tmp_path], capture_output=True, text=True)
        assert after.stdout == "open\n"


def test_where_files_have_no_locks_of_their_own_processes_keep_each_other_out(
    tmp_path: Path,
) -> None:
    waits = MAIN.replace("ACT", AND_WAITS).replace("int main", f"{OF_PROCESSES}int main")
    old = program(tmp_path, "old", waits, "-Dfcntl=fcntl_of_old")
    new = program(tmp_path, "new", MAIN.replace("ACT", AND_WAITS))
    pipes = {"stdin": processes.PIPE, "stdout": processes.PIPE, "text": True}
    for first, second in ((old, old), (old, new), (new, old)):
        with processes.started([first, tmp_path], **pipes) as process:
            assert lines_of(process, 1) == ["open"]
            beside = processes.run(
                [second, tmp_path], stdin=processes.DEVNULL, capture_output=True, text=True
            )
            assert beside.stdout == f"{REFUSED}\n"
