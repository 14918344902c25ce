"""Values between two processes: whole or refused, from C and from Python, and no data race."""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
from typing import TYPE_CHECKING, Any

import pytest

import processes
from generators.c_packages import command, make
from generators.posix_packages import FAST as AC
from generators.posix_packages import FORGIVING, cart_with_extern
from soter.native.compiler import find_compiler
from soter.native.shared_library import RUNTIME
from soter.workers import exchange as channel_of_python

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

POSIX = RUNTIME / "posix"
WORDS = 5
RACE = """\
#include "soter_channel.h"
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#define SIZE 40
static uint64_t segment[8 + 5];
static uint64_t turn;

static void* writes(void* none) {
  for (uint64_t n = 1; n <= 20000; n++) {
    uint64_t value[5];
    for (int i = 0; i < 5; i++) value[i] = n * 3 + (uint64_t)i;
    const soter_channel_head head = {.hash = 7, .number = n};
    soter_channel_write(segment, &head, SIZE, value);
    __atomic_store_n(&turn, n, __ATOMIC_RELEASE);
  }
  return none;
}

int main(void) {
  pthread_t writer;
  pthread_create(&writer, NULL, writes, NULL);
  long fresh = 0, wrong = 0;
  uint64_t now = 0;
  while (now < 20000) {
    soter_channel_head head;
    uint64_t value[5];
    now = __atomic_load_n(&turn, __ATOMIC_ACQUIRE);
    if (soter_channel_read(segment, 7, SIZE, now, &head, value) == SOTER_CHANNEL_FRESH) {
      fresh++;
      for (int i = 0; i < 5; i++) wrong += value[i] != now * 3 + (uint64_t)i;
    }
  }
  pthread_join(writer, NULL);
  printf("%ld %ld\\n", fresh, wrong);
  return 0;
}
"""


def sanitized(folder: Path, kind: str) -> bool:
    """Whether this machine can compile and run with a sanitizer."""
    (folder / "probe.c").write_text("int main(void) { return 0; }\n")
    done = processes.run(
        ["cc", f"-fsanitize={kind}", "-o", folder / "probe", folder / "probe.c"],
        capture_output=True,
    )
    return done.returncode == 0 and processes.run([folder / "probe"]).returncode == 0


@pytest.mark.parametrize("kind", ["thread", "address,undefined"])
def test_a_reader_beside_a_writer_sees_whole_values(tmp_path: Path, kind: str) -> None:
    if not sanitized(tmp_path, kind):
        pytest.skip(f"no sanitizer for {kind} here")
    (tmp_path / "race.c").write_text(RACE)
    sources = [tmp_path / "race.c", POSIX / "soter_channel.c", POSIX / "soter_posix_check.c"]
    processes.run(
        ["cc", "-O1", "-g", f"-fsanitize={kind}", "-pthread", f"-I{POSIX}", f"-I{RUNTIME}", "-o",
         tmp_path / "race", *sources],
        check=True,
    )  # fmt: skip
    done = processes.run([tmp_path / "race"], capture_output=True, text=True, check=True)
    fresh, wrong = map(int, done.stdout.split())
    assert fresh > 0
    assert wrong == 0
    assert "WARNING" not in done.stderr


@pytest.mark.parametrize("kind", ["thread", "address,undefined"])
def test_the_driver_is_clean_under_sanitizers(tmp_path: Path, kind: str) -> None:
    if not sanitized(tmp_path, kind):
        pytest.skip(f"no sanitizer for {kind} here")
    import soter

    source = cart_with_extern(tmp_path / "source")
    (source.parent / "fast.c").write_text(AC)
    soter.load(source).build("posix", tmp_path / "out")
    made = make(tmp_path / "out", f"CFLAGS=-O1 -g -fsanitize={kind}")
    assert made.returncode == 0, made.stderr
    drop = ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--securebits=+noroot"]
    words = [*(drop if os.geteuid() == 0 else []), "./cart", "--until", "0.6", *FORGIVING]
    done = command([*words, "--worker-memory", "0"], tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "Sanitizer" not in done.stderr
    assert "runtime error" not in done.stderr
    assert "61 asked" in done.stdout


# ---------------------------------------------------------------- Python and C


@pytest.fixture(scope="module")
def c_side(tmp_path_factory: pytest.TempPathFactory) -> Any:
    library = tmp_path_factory.mktemp("channel") / "channel.so"
    to_library = [*find_compiler().command, "-shared", "-fPIC", "-o", str(library)]
    sources = [str(POSIX / name) for name in ("soter_channel.c", "soter_posix_check.c")]
    processes.run([*to_library, f"-I{RUNTIME}", *sources], check=True)
    return ctypes.CDLL(str(library))


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> tuple[mmap.mmap, mmap.mmap]:
    """The segments, ours to look at, and the files of the worker's side."""
    asked, given = (os.memfd_create(n) for n in ("asked", "given"))
    for fd in (asked, given):
        os.ftruncate(fd, 8 * (8 + WORDS))
    monkeypatch.setattr(channel_of_python, "REQUEST_FD", asked)
    monkeypatch.setattr(channel_of_python, "ANSWER_FD", given)
    return mmap.mmap(asked, 0), mmap.mmap(given, 0)


def test_python_reads_what_c_wrote_and_c_what_python_answered(
    c_side: Any,
    both: tuple[mmap.mmap, mmap.mmap],
) -> None:
    size = 8 * WORDS - 3
    side = channel_of_python.Channel(99, (size, size))
    head = (ctypes.c_uint64 * 8)(0, 99, 0, 5, 123, 0, 0, 1)
    value = (ctypes.c_uint64 * WORDS)(*range(10, 10 + WORDS))
    asked = ctypes.c_char.from_buffer(both[0])
    given = ctypes.c_char.from_buffer(both[1])
    c_side.soter_channel_write(ctypes.byref(asked), head, ctypes.c_size_t(size), value)
    request = side.next_request()
    assert (request.number, request.time_ns, request.data) == (5, 123, bytes(value)[:size])

    def read(number: int, layout: int = 99) -> int:
        answer = (ctypes.c_uint64 * WORDS)()
        told = (ctypes.c_uint64 * 8)()
        state: int = c_side.soter_channel_read(
            ctypes.byref(given),
            ctypes.c_uint64(layout),
            ctypes.c_size_t(size),
            ctypes.c_uint64(number),
            told,
            answer,
        )
        if state == 0:
            assert bytes(answer)[:size] == request.data[::-1]
        return state

    fresh, other, torn, wrong_layout, empty = 0, 1, 2, 4, 5
    assert read(5) == empty
    side.answer(request, request.data[::-1])
    assert [read(5), read(6), read(5, 98)] == [fresh, other, wrong_layout]
    both[1][8 * 8] ^= 1
    assert read(5) == torn
    both[1][8 * 8] ^= 1
    assert read(5) == fresh
    both[1][0] |= 1
    assert read(5) == torn


def test_a_request_of_another_layout_is_an_error(
    c_side: Any,
    both: tuple[mmap.mmap, mmap.mmap],
) -> None:
    side = channel_of_python.Channel(99, (8, 8))
    head = (ctypes.c_uint64 * 8)(0, 98, 0, 1, 0, 0, 0, 0)
    value = (ctypes.c_uint64 * WORDS)()
    asked = ctypes.c_char.from_buffer(both[0])
    c_side.soter_channel_write(ctypes.byref(asked), head, ctypes.c_size_t(8), value)
    with pytest.raises(channel_of_python.LayoutError):
        side.next_request()
