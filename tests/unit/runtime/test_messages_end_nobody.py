"""Whoever reads what a process says, or nobody: one that acts goes on, and ends as it is told.

The trusted part runs over the clock of the test, so its run is complete however it is scheduled.
"""

from __future__ import annotations

import json
import os
import pickle
import pty
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

import processes
from generators.c_packages import CART
from generators.posix_packages import owned
from soter.language.front_end import check_file, system_of
from soter.simulate.flight_recording import FlightRecording

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

INSTANTS = 201
"""Of the cart in a second."""
UNTIL = ("--until", "1", "--bare", "0")
STREAMS = ("stdin", "stdout", "stderr")
ENDS = [signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGALRM]
ENDS += [signal.SIGPROF, signal.SIGXCPU, signal.SIGPWR, signal.SIGIO, signal.SIGVTALRM]
ENDS += [signal.SIGRTMIN, signal.SIGRTMAX]


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return owned(CART, tmp_path_factory.mktemp("cart") / "out")


# ---------------------------------------------------------------- whoever reads, or nobody


def full_pipe() -> tuple[int, int]:
    """A pipe that nobody empties: both ends, the second to write to."""
    ends = os.pipe()
    os.set_blocking(ends[1], False)
    for size in (4096, 1):
        with suppress(BlockingIOError):
            while True:
                os.write(ends[1], b" " * size)
    os.set_blocking(ends[1], True)
    return ends


def full_and_not_waiting() -> tuple[int, int]:
    """Whoever else has it made it so that a writer does not wait."""
    ends = full_pipe()
    os.set_blocking(ends[1], False)
    return ends


def read_by_nobody() -> tuple[int]:
    reader, writer = os.pipe()
    os.close(reader)
    return (writer,)


def full_disk() -> tuple[int]:
    return (os.open("/dev/full", os.O_WRONLY),)


def stopped_terminal() -> tuple[int, int]:
    """Somebody pressed Ctrl-S."""
    mine, its = pty.openpty()
    os.write(mine, b"\x13")
    return mine, its


def terminal_gone() -> tuple[int]:
    mine, its = pty.openpty()
    os.close(mine)
    return (its,)


READERS: dict[str, Callable[[], tuple[int, ...]]] = {
    "full pipe": full_pipe,
    "full pipe that does not wait": full_and_not_waiting,
    "no reader": read_by_nobody,
    "full disk": full_disk,
    "stopped terminal": stopped_terminal,
    "terminal gone": terminal_gone,
}


def run(program: Path, *words: str | Path, **given: Any) -> processes.Done:
    """The cart's run; quick, as the clock is the test's."""
    given.setdefault("stdout", processes.PIPE)
    given.setdefault("stderr", processes.PIPE)
    return processes.run([program, *UNTIL, *words], **given)


@pytest.mark.parametrize("closed", range(1, 8))
def test_closed_descriptors_are_no_file_of_its_own(cart: Path, tmp_path: Path, closed: int) -> None:
    """What is opened next would be one of them, and words would stand in it."""
    record = tmp_path / "flight"
    files = [n for n in range(3) if closed >> n & 1]

    def before() -> None:
        for number in files:
            os.close(number)

    out = (tmp_path / "out").open("wb")
    with out:
        done = run(cart, "--json", "--record", record, stdout=out, preexec_fn=before)
    assert done.returncode == 0
    assert record.read_bytes().startswith(b"soter recording 1")
    flight = FlightRecording(record, system_of(check_file(str(CART)), "Protected"))
    seen: list[list[object]] = []
    flight.show_states_to(type("Seen", (), {"observe_states": seen.append})())
    assert sum(len(one) for one in seen) == INSTANTS
    assert flight.cut == ""
    if 1 not in files:
        assert json.loads((tmp_path / "out").read_text())["instants"] == INSTANTS


@pytest.mark.parametrize("reader", READERS)
def test_words_that_nobody_takes_hold_nothing_up(cart: Path, tmp_path: Path, reader: str) -> None:
    """Standard error: notes are lost there, and stand in the report."""
    files = READERS[reader]()
    log = tmp_path / "no such folder" / "log"
    done = run(cart, "--log", log, "--json", stderr=files[-1])
    for file in files:
        os.close(file)
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert told["instants"] == INSTANTS
    assert any("no such folder" in note for note in told["notes"])


STUCK = [
    pytest.param(reader, marks=pytest.mark.long) for reader in ("full pipe", "stopped terminal")
]


@pytest.mark.parametrize("reader", ["no reader", "full disk", "terminal gone", *STUCK])
def test_a_report_that_cannot_be_written_is_no_success(cart: Path, reader: str) -> None:
    """Nor does it keep the process: whoever stands still has five seconds."""
    files = READERS[reader]()
    done = run(cart, "--json", stdout=files[-1])
    for file in files:
        os.close(file)
    assert done.returncode == 1


def test_a_report_is_whole_however_late_it_is_read(cart: Path) -> None:
    """Whoever reads it has a buffer of a pipe, and takes it a piece at a time."""
    whole = json.loads(run(cart, "--json").stdout)
    command: list[str | Path] = [cart, *UNTIL, "--json", "--quiet"]
    with processes.started(command, stdout=processes.PIPE, bufsize=0) as process:
        assert process.stdout is not None
        text = b""
        while piece := process.stdout.read(97):
            text += piece
        assert process.wait() == 0
    assert json.loads(text)["trace_sha256"] == whole["trace_sha256"]


WORKER = """
import sys
from soter.simulate.externs import extern_process

def talk(*_):
    for file in (sys.stdout, sys.stderr, sys.__stdout__, sys.__stderr__):
        print("what a policy says " * 5000, file=file, flush=True)
    raise SystemExit(7)

extern_process.Channel = talk
extern_process.main(sys.argv[1])
"""
"""A worker in Python, whose policy speaks before it is asked anything."""


def test_what_a_policy_in_python_prints_never_raises(tmp_path: Path) -> None:
    spec = SimpleNamespace(exchange=SimpleNamespace(number=1, sizes=(8, 8)))
    (tmp_path / "spec").write_bytes(pickle.dumps(spec))
    files = full_and_not_waiting()
    words: list[str | Path] = [sys.executable, "-c", WORKER, tmp_path / "spec"]
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    done = processes.run(words, stdout=files[-1], stderr=files[-1], env=buffered)
    for file in files:
        os.close(file)
    assert done.returncode == 7


# ---------------------------------------------------------------- what is written beside the flight


def limited(size: int) -> Callable[[], None]:
    """Of files: more is refused, and a signal comes with it. No half bytecode is left behind."""

    def limits() -> None:
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limits


def goes_on(cart: Path, option: str, path: str, **given: Any) -> str:
    """The one note of a run whose log ends: it is said once, and the run ends as any other."""
    done = run(cart, option, path, "--json", cwd=cart.parent, **given)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["instants"] == INSTANTS
    said: list[str] = [n for n in told["notes"] if " log " in n]
    assert len(said) == 1, told["notes"]
    assert done.stderr.decode().count(said[0]) == 1
    return said[0]


@pytest.mark.parametrize("option", ["--log", "--record"])
@pytest.mark.parametrize("reader", ["no reader", "full disk", "terminal gone"])
def test_a_log_that_nobody_takes_ends_and_the_run_goes_on(
    cart: Path, option: str, reader: str
) -> None:
    files = READERS[reader]()
    said = goes_on(cart, option, f"/dev/fd/{files[-1]}", pass_fds=files[-1:])
    for file in files:
        os.close(file)
    assert "cannot be written" in said


@pytest.mark.parametrize("option", ["--log", "--record"])
@pytest.mark.parametrize("size", [0, 1, 4096, 5000])
def test_a_log_longer_than_a_file_may_be_ends_and_the_run_goes_on(
    cart: Path, option: str, size: int
) -> None:
    said = goes_on(cart, option, f"log_{option}_{size}", preexec_fn=limited(size))
    assert "File too large" in said


@pytest.mark.long
@pytest.mark.parametrize("option", ["--log", "--record"])
@pytest.mark.parametrize("reader", ["full pipe", "stopped terminal"])
def test_a_log_whose_reader_stands_still_is_left_and_the_run_ends(
    cart: Path, option: str, reader: str
) -> None:
    files = READERS[reader]()
    said = goes_on(cart, option, f"/dev/fd/{files[-1]}", pass_fds=files[-1:])
    for file in files:
        os.close(file)
    assert "nobody takes" in said


@pytest.mark.long
def test_a_pipe_that_never_has_a_reader_does_not_keep_a_run_that_is_ended(
    cart: Path, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "log")
    options = ["--until", "1000", "--log", str(tmp_path / "log"), "--json"]
    environment = {**os.environ, "OWNED_CLOCK": "terminated:500000000:0"}
    done = processes.run([cart, *options], capture_output=True, env=environment)
    assert done.returncode == 130
    assert any("nobody takes" in n for n in json.loads(done.stdout)["notes"])


@pytest.mark.parametrize("most", [16, 32, 64])
def test_few_descriptors_are_enough(cart: Path, most: int) -> None:
    done = run(
        cart, "--json", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["instants"] == INSTANTS


def test_a_disk_without_room_is_told_of_a_compiler(tmp_path: Path) -> None:
    """The compiler has it, and its words are in its language: what is written is tried."""
    environment = {**os.environ, "SOTER_CACHE": str(tmp_path / "cache"), "TMPDIR": str(tmp_path)}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    words = [sys.executable, "-m", "soter", "run", str(CART), "--until", "1s", "--seed", "7"]
    done = processes.run(words, capture_output=True, env=environment, preexec_fn=limited(20_000))
    said = done.stderr.decode()
    assert done.returncode == 1
    assert "error[D006]: nothing compiles without room in" in said
    assert "file too large" in said
    assert "defect" not in said


@pytest.mark.parametrize("most", [4, 8, 9, 10, 16])
def test_a_log_that_no_thread_can_write_is_told(cart: Path, tmp_path: Path, most: int) -> None:
    """Memory that is locked may leave no room, MiB, for the stack of one more."""
    if os.geteuid() != 0:
        pytest.skip("nobody to take permissions from")
    without = ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--securebits=+noroot"]
    words: list[str | Path] = [
        *without,
        "prlimit",
        f"--memlock={most << 20}",
        cart,
        *UNTIL,
        "--json",
    ]
    done = processes.run([*words, "--record", tmp_path / "flight"], capture_output=True)
    assert done.returncode in (0, 1), "1: nothing may be run at all"
    if done.returncode == 0:
        notes = json.loads(done.stdout)["notes"]
        assert (tmp_path / "flight").exists() != any("no thread" in note for note in notes)


# ---------------------------------------------------------------- signals


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_ends_the_trusted_part_with_a_report(cart: Path, number: signal.Signals) -> None:
    command: list[str | Path] = [cart, "--until", "1000000", "--json", "--quiet"]
    with processes.started(command, stdout=processes.PIPE) as process:
        status = Path(f"/proc/{process.pid}/status")

        def heeds() -> bool:
            _, _, caught = status.read_text().partition("SigCgt:")
            return bool(int(caught.split()[0], 16) >> (number - 1) & 1)

        processes.until(heeds, process)
        process.send_signal(number)
        out, _ = process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == 130
    assert not out or json.loads(out)["stopped"] is True


def test_a_signal_that_comes_to_a_thread_of_words_ends_the_run_as_any_other(cart: Path) -> None:
    """Of two that come at once the second goes to another thread than the first."""
    command: list[str | Path] = [cart, "--until", "1000000", "--json", "--quiet"]
    with processes.started(command, stdout=processes.PIPE) as process:
        threads = Path(f"/proc/{process.pid}/task")
        processes.until(lambda: len([*threads.iterdir()]) > len(STREAMS), process)
        _, first, *_ = sorted(int(thread.name) for thread in threads.iterdir())
        os.kill(first, signal.SIGTERM)
        out, _ = process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == 130
    assert json.loads(out)["stopped"] is True


def test_nohup_is_heeded(cart: Path) -> None:
    def ignored() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    command: list[str | Path] = [cart, "--until", "1000000", "--json", "--quiet"]
    with processes.started(command, stdout=processes.PIPE, preexec_fn=ignored) as process:
        processes.computed(process, 0.05)
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGCONT)
        processes.computed(process, 0.1)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == 130
