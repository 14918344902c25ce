"""Command lines run in forks of a process that has everything imported: exits, ends, orphans.

Purpose: thousands of commands a minute, each alone in a folder of its own, with its words in a
file, ended after `LIMIT_S`; whatever process outlives its command is counted and ended.
Non-goals: what is run. Linux (orphans come to this process, PR_SET_CHILD_SUBREAPER).
"""

from __future__ import annotations

import ctypes
import os
import re
import resource
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

LIMIT_S = 20.0
LINGER_S = 1.0
"""What a command started may take so long to notice that it is gone."""
MEMORY = 6 * 2**30
PR_SET_CHILD_SUBREAPER = 36
INTERNAL = 70
FRAME = re.compile(r'File "[^"]*/(soter/[^"]+)", line (\d+)')
EXITS = (0, 1, 2, 3, 4, 5)
ACCEPTED = (0, 3, 4)
"""Of a sample that nothing is wrong with: its program may be violated, its case incomplete."""


@dataclass(frozen=True)
class Tried:
    """A command line: what was wrong with its input, and what became of it.

    `exit`: None where it hung, negative where a signal ended it.
    """

    what: str
    words: tuple[str, ...]
    exit: int | None
    orphans: int
    took_s: float
    said: str

    @property
    def wrong(self) -> str:
        """What may never be, in words; "" where nothing of it was."""
        if self.orphans:
            return f"{self.orphans} processes outlive it"
        if self.exit in EXITS:
            return ""
        if self.exit is None:
            return f"it hangs ({self.words[0]})"
        frames = FRAME.findall(self.said)
        where = f"{frames[-1][0]}:{frames[-1][1]}" if frames else self.words[0]
        last = self.said.strip().rsplit("\n", 1)[-1][:120]
        return f"exit {self.exit} in {where}: {last}"


class Forked:
    """Runs command lines; `folder` makes a copy of the sample that the next one may spoil."""

    def __init__(self, work: Path) -> None:
        self.work = work
        self.memory = MEMORY
        self._made = 0
        work.mkdir(parents=True, exist_ok=True)
        _import_all()
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)

    def folder(self, sample: Path) -> Path:
        """A fresh copy of the sample."""
        self._made += 1
        made = self.work / f"{self._made}"
        shutil.copytree(sample, made, symlinks=True)
        return made

    def warm(self, words: list[str], sample: Path, stdin: str = "") -> None:
        """Run `soter WORDS` on a copy of the sample, which has to be accepted, in this process.

        What it imports, compiles and reads of its own stays for the forks.
        """
        folder, said = self.folder(sample), self.work / "warm.said"
        streams, place = [os.dup(fd) for fd in range(3)], Path.cwd()
        out, source = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), -1
        try:
            os.chdir(folder)
            source = os.open(stdin or os.devnull, os.O_RDONLY)
            for fd, to in ((source, 0), (out, 1), (out, 2)):
                os.dup2(fd, to)
            code = _exit_of(words)
            sys.stdout.flush()
        finally:
            os.chdir(place)
            for fd, old in enumerate(streams):
                os.dup2(old, fd)
            for fd in (*streams, out, source):
                os.close(fd)
        assert code in ACCEPTED, (words, code, said.read_text(errors="replace")[-2000:])
        assert threading.active_count() == 1, (words, threading.enumerate())
        shutil.rmtree(folder, ignore_errors=True)

    def accepted(self, words: list[str], sample: Path, stdin: str = "") -> None:
        """The same in a fork: nothing stays of it."""
        tried = self.run(words, self.folder(sample), "the sample", stdin)
        assert tried.exit in ACCEPTED, (words, tried)

    def run(
        self,
        words: list[str],
        folder: Path,
        what: str,
        stdin: str = "",
        look: Callable[[], object] = lambda: None,
    ) -> Tried:
        """Run `soter WORDS` in the folder, which is gone when `look` has looked."""
        said = folder.with_suffix(".said")
        start = time.monotonic()
        pid = os.fork()
        if pid == 0:
            _command(words, folder, said, stdin, self.memory)
        code = _ended(pid, start + LIMIT_S)
        took = time.monotonic() - start
        orphans = _orphans(pid)
        text = said.read_text(errors="replace") if said.exists() else ""
        said.unlink(missing_ok=True)
        look()
        shutil.rmtree(folder, ignore_errors=True)
        return Tried(what, tuple(words), code, orphans, took, text)


def _import_all() -> None:
    """Every module of soter and what it needs; optional packages may be missing."""
    import importlib  # noqa: PLC0415 - what commands import late
    import pkgutil  # noqa: PLC0415 - the same

    import soter  # noqa: PLC0415 - the same

    for module_info in pkgutil.walk_packages(soter.__path__, "soter."):
        if not module_info.name.endswith("__main__"):
            with suppress(ImportError):
                importlib.import_module(module_info.name)
    for name in ("mcap.reader", "pygls", "flint"):
        with suppress(ImportError):
            importlib.import_module(name)


CALLS: dict[str, Callable[[str], int]] = {}
"""Words that are no command of `soter` -> what reads the file that is named behind them."""


def _exit_of(words: list[str]) -> int:
    """The exit code of a command line in this process."""
    from soter.cli.main import main  # noqa: PLC0415 - in a fork, mostly
    from soter.diagnostics.diagnostic import SoterError  # noqa: PLC0415 - the same

    try:
        return CALLS[words[0]](words[1]) if words[0] in CALLS else main(words)
    except (SoterError, OSError) as refused:
        sys.stderr.write(f"{refused}\n")
        return 1
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else INTERNAL


def mapped() -> int:
    """Bytes of address space that this process has."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * os.sysconf("SC_PAGE_SIZE")


def _command(words: list[str], folder: Path, said: Path, stdin: str, memory: int) -> None:
    """The life of a fork: one command line, then its exit code. Never returns."""
    code = INTERNAL
    try:
        os.setsid()
        os.chdir(folder)
        out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        source = os.open(stdin or os.devnull, os.O_RDONLY | os.O_NONBLOCK)
        os.set_blocking(source, True)
        os.dup2(source, 0)
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.stdin = open(0, encoding="utf-8", errors="surrogateescape", closefd=False)  # noqa: SIM115
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        from soter.cli import main as crash_report  # noqa: PLC0415 - the same

        crash_report.apologise = _apologise  # type: ignore[assignment] # what failed, in full
        code = _exit_of(words)
    except BaseException as error:  # noqa: BLE001 - a defect too
        _apologise(error, words)
    finally:
        with suppress(BaseException):
            threading._shutdown()  # type: ignore[attr-defined] # noqa: SLF001 - as at every end
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code & 0xFF)


def _apologise(error: BaseException, words: list[str]) -> object:
    import traceback  # noqa: PLC0415 - only then

    from soter.diagnostics.diagnostic import Diagnostic  # noqa: PLC0415 - the same

    text = "".join(traceback.format_exception(type(error), error, error.__traceback__))
    os.write(2, (text + "\n").encode(errors="replace"))
    return Diagnostic("I001", f"{type(error).__name__}: {error}"[:200], notes=(str(words)[:100],))


def _ended(pid: int, end: float) -> int | None:
    """The exit code; None where it had to be killed. Orphans of others are left alone."""
    nap = 0.001
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            return None
        time.sleep(nap)
        nap = min(2 * nap, 0.02)


def _orphans(session: int) -> int:
    """Processes of the session, and our adopted children, that are still there; they are ended."""
    end = time.monotonic() + LINGER_S
    while left := _of_session(session):
        if time.monotonic() > end:
            for pid in left:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                with suppress(ChildProcessError):
                    os.waitpid(pid, 0)
            return len(left)
        time.sleep(0.01)
    return 0


def _of_session(session: int) -> list[int]:
    """Who lives of the session, or was adopted from whoever left it; zombies are waited for."""
    pids = []
    for place in Path("/proc").iterdir():
        if not place.name.isdigit():
            continue
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        pid, state, parent, of = int(place.name), fields[0], int(fields[1]), int(fields[3])
        if of != session and not (parent == os.getpid() and of != os.getsid(0) and of == pid):
            continue
        if parent == os.getpid() and state == "Z":
            with suppress(ChildProcessError):
                os.waitpid(pid, os.WNOHANG)
        elif state != "Z":
            pids.append(pid)
    return pids
