"""Where a command's words go, and in which characters and figures.

Purpose: results on standard output, everything else on standard error, colour only where a
person looks; with `--json` one document on standard output and nothing else, whatever an extern
prints; closed pipes and full disks end quietly or with a sentence. `ResultPipe`: a child process
leaves its words and its exit code in a file without a name, whole or not at all, which externs that
the child ran reach by no accident. Where an encoding or a terminal has no other characters, plain
ones (`->` for an arrow in place of `?`); rates and sizes with three digits and a unit.
Non-goals: what is said; an extern that means to reach the result: it runs in the child, with all
its rights; times (`language/model/durations.py`).
"""

from __future__ import annotations

import codecs
import hashlib
import io
import os
import re
import shutil
import signal
import sys
import threading
import time
from contextlib import ExitStack, suppress
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from contextlib import AbstractContextManager
    from types import TracebackType
    from typing import NoReturn

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.report.terminal_tables import Entry


DASHES = "\u2500\u2501\u2504\u2505\u254c\u254d\u2010\u2011\u2013\u2014\u2015\u2212"
BARS = "\u2502\u2503\u2506\u250a\u258f\u2595\u254e"
CORNERS = "\u250c\u2510\u2514\u2518\u251c\u2524\u252c\u2534\u253c\u256d\u256e\u256f\u2570"
BLOCKS = "\u2588\u2593\u2592\u2591\u25a0\u2587\u2586\u2585\u2584\u2583\u2582\u2581"
DOTS = "\u00b7\u2022\u2219\u25cf"
PLAIN = {
    **dict.fromkeys(DASHES, "-"),
    **dict.fromkeys(BARS, "|"),
    **dict.fromkeys(CORNERS, "+"),
    **dict.fromkeys(BLOCKS, "#"),
    **dict.fromkeys(DOTS, "*"),
    "\u2192": "->",
    "\u2190": "<-",
    "\u2194": "<->",
    "\u21d2": "=>",
    "\u2264": "<=",
    "\u2265": ">=",
    "\u2260": "!=",
    "\u2248": "~",
    "\u221e": "inf",
    "\u00d7": "x",
    "\u00b5": "u",
    "\u03bc": "u",
    "\u00b0": " deg",
    "\u00b1": "+-",
    "\u00b2": "^2",
    "\u00b3": "^3",
    "\u221a": "sqrt",
    "\u2208": "in",
    "\u2026": "...",
    "\u0394": "Delta",
    "\u03b4": "delta",
    "\u03c0": "pi",
    "\u00a7": "section ",
    "\u2018": "'",
    "\u2019": "'",
    "\u201c": '"',
    "\u201d": '"',
    "\u00a0": " ",
    "\u2713": "ok",
    "\u2717": "x",
}
"""What is written for what is not there; everything else becomes `?` where it cannot be written."""
_TABLE = str.maketrans(PLAIN)
PLAIN_ERRORS = "soter.plain"
TERMS = re.compile(r"(dumb|unknown|ansi|cons25|vt(52|1\d\d|2\d\d))(-.*)?")


def draws_no_boxes(term: str) -> bool:
    """Whether a terminal, by its $TERM, is one of those that have plain characters only."""
    return TERMS.fullmatch(term) is not None


def plainly(text: str) -> str:
    """A text in plain characters, as far as they are known; the rest stays."""
    return text.translate(_TABLE)


def _encoded(error: UnicodeError) -> tuple[str, int]:
    """What an encoding does not have, in characters that it has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(PLAIN.get(char, "?") for char in missing), error.end


codecs.register_error(PLAIN_ERRORS, _encoded)


def rounded(x: float) -> str:
    """A rate: `1.4 M`, `23 k`, `840`."""
    for unit, factor in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if x >= 0.9995 * factor:
            return f"{x / factor:.3g} {unit}"
    return f"{x:.0f}"


def size(count: int) -> str:
    """A size: `9.6 MB`."""
    for unit, factor in (("GB", 2**30), ("MB", 2**20), ("kB", 2**10)):
        if count >= 0.9995 * factor:
            return f"{count / factor:.{3 if count < 999.5 * factor else 4}g} {unit}"
    return f"{count} bytes"


def decimal(count: int) -> str:
    """A size on a disk, in units of 1000: `481 MB`."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= 0.9995 * factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count} bytes"


THREADS_S = 1.0
"""How long the threads that externs leave behind may take to end."""
HIGH = 200
"""Descriptors that an extern closes or writes to by mistake are lower."""


class ChildResult(Exception):  # noqa: N818 - no error: the command was done, in the child
    """The verdict of a child: what it had to say on standard output, and its exit code."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(exit_code)
        self.text = text
        self.exit = exit_code


class ResultPipe:
    """Where a child leaves its result. `mark` and a hash tell it from what is there by accident."""

    def __init__(self) -> None:
        self._file = _nameless()
        self._mark = os.urandom(16)
        self._process = 0

    def begin(self) -> None:
        """This is the process that may leave one."""
        self._process = os.getpid()

    def leave(self, text: str, exit_code: int) -> NoReturn:
        """Leave a result and end the process; a copy of it that an extern made only ends."""
        if os.getpid() != self._process:
            os._exit(1)
        body = bytes([exit_code]) + text.encode("utf-8", "surrogateescape")
        whole = memoryview(self._mark + self._hash(body) + body)
        at = 0
        with suppress(OSError):
            while at < len(whole):
                at += os.pwrite(self._file, whole[at:], at)
        with suppress(OSError):  # an extern may have stopped who is to tell it
            os.kill(os.getppid(), signal.SIGCONT)
        _end(exit_code)

    def found(self) -> ChildResult | None:
        """What was left; None where nothing whole was."""
        size = os.fstat(self._file).st_size
        whole = bytearray()
        while len(whole) < size and (part := os.pread(self._file, size - len(whole), len(whole))):
            whole += part
        mark, digest, body = bytes(whole[:16]), bytes(whole[16:48]), bytes(whole[48:])
        if not body or mark != self._mark or digest != self._hash(body):
            return None
        return ChildResult(body[1:].decode("utf-8", "surrogateescape"), body[0])

    def _hash(self, body: bytes) -> bytes:
        return hashlib.sha256(self._mark + body).digest()


def _nameless() -> int:
    """A file without a name that no program started by an extern inherits."""
    if sys.platform == "linux":
        made = os.memfd_create("soter verdict")
    else:
        import tempfile  # noqa: PLC0415 - only here

        with tempfile.TemporaryFile() as file:
            made = os.dup(file.fileno())
    import fcntl  # noqa: PLC0415 - not everywhere

    with suppress(OSError):
        high = fcntl.fcntl(made, fcntl.F_DUPFD_CLOEXEC, HIGH)
        os.close(made)
        return high
    return made


def _end(exit_code: int) -> NoReturn:
    """End, whatever externs have left running: what they asked for at the end is done first."""
    import atexit  # noqa: PLC0415 - only here

    until_s = time.monotonic() + THREADS_S
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join(max(until_s - time.monotonic(), 0.0))
            if thread.is_alive():
                os.write(2, b"soter: an extern left a thread running, which ends here\n")
                break
    with suppress(BaseException):
        atexit._run_exitfuncs()  # noqa: SLF001 - Python's own order
    for stream in (sys.stdout, sys.stderr):
        with suppress(BaseException):
            stream.flush()
    os._exit(exit_code)


STYLES = {"bold": "1", "muted": "2", "red": "1;31", "green": "1;32", "yellow": "1;33", "blue": "34"}


class Console:
    """The two streams of one command. A context: leaving it puts `sys.stdout` back."""

    def __init__(self, *, json: bool, own_process: bool = False) -> None:
        self.json = json
        self.own_process = own_process
        self.of_program: tuple[Diagnostic, ...] = ()
        """What was found in the program that the command is about, to be told however it ends."""
        """Whether this process is the command, and not somebody's who calls `main`."""
        self._verdict: ResultPipe | None = None
        self._during = ExitStack()
        self.out: IO[str] | None = sys.stdout
        self.err: IO[str] | None = sys.stderr
        self._shown_on = self.out
        self._plain_out = self._plain_err = False
        self.output_error: OSError | None = None
        """Why standard output took no more; a closed pipe is no error."""
        self._saved: IO[str] | None = None
        self._guarded_fd = False

    def __enter__(self) -> Console:  # noqa: PYI034 - typing.Self came with Python 3.11
        for stream in (self.out, self.err):
            with suppress(AttributeError, ValueError, OSError):
                stream.reconfigure(errors=PLAIN_ERRORS)  # type: ignore[union-attr]
        self.color_out = colorful(self.out)
        self.color_err = colorful(self.err)
        self._plain_out, self._plain_err = plain_terminal(self.out), plain_terminal(self.err)
        self.ascii_only = self._plain_out or (
            not (getattr(self.out, "encoding", None) or "ascii").lower().startswith("utf")
        )
        if self.json:
            self._guard()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._during.close()
        if self._saved is not None:
            self._unguard()

    def during(self, context: AbstractContextManager[None]) -> None:
        """Enter a context that lasts as long as the command."""
        self._during.enter_context(context)

    def listen(self) -> None:
        """From here to the end Ctrl-C, SIGTERM and SIGHUP keep what was reached."""
        from soter.simulate.interrupt import (  # noqa: PLC0415 - NumPy
            ANY_END,
            StopRequest,
            listening,
        )

        self.during(listening(StopRequest(), ANY_END))

    # ------------------------------------------------------------ a child that prints nothing

    def leave_to(self, verdict: ResultPipe) -> None:
        """Keep from now on what would be printed: the parent prints it (`child_process.py`)."""
        self._verdict = verdict
        self.out = io.StringIO()
        self._plain_out = False  # the parent sees to it

    def hand_over(self, exit_code: int) -> None:
        """Give the parent of this process what is printed, and end; nothing without a parent."""
        if self._verdict is not None:
            assert isinstance(self.out, io.StringIO)
            _flush_c()
            self._verdict.leave(self.out.getvalue(), exit_code)

    def from_child(self, text: str) -> None:
        """What the child of this process would have printed."""
        self._write(text)

    # ------------------------------------------------------------ writing

    def say(self, text: str = "") -> None:
        """A result, for people: nothing with `--json`."""
        if not self.json:
            self._write(text + "\n")

    def document(self, text: str) -> None:
        """The JSON document."""
        self._write(text + "\n")

    def note(self, text: str) -> None:
        """Something beside the result."""
        if self.err is not None:
            with suppress(OSError, ValueError):
                self.err.write((plainly(text) if self._plain_err else text) + "\n")
                self.err.flush()

    def diagnostics(self, items: tuple[Diagnostic, ...]) -> None:
        """Diagnostics, for people."""
        if items and not self.json:
            from soter.diagnostics.render import render_all  # noqa: PLC0415 - only then

            self.note(render_all(items, color=self.color_err))

    def paint(self, style: str, text: str) -> str:
        """`text` in colour where standard output shows it; as it is in a style nobody knows."""
        return painted(style, text) if self.color_out else text

    @property
    def width(self) -> int | None:
        """Columns of the terminal, or of $COLUMNS; None where nobody's columns are known."""
        if not os.environ.get("COLUMNS", "").isdigit() and not is_terminal(self._shown_on):
            return None
        return max(shutil.get_terminal_size((80, 24)).columns, 20)

    def table(self, headers: Sequence[str], rows: Iterable[Sequence[Entry]]) -> str:
        """A table, in colour and no wider than the terminal where it can be."""
        from soter.report.terminal_tables import table  # noqa: PLC0415 - needs NumPy

        return table(headers, rows, color=self.color_out, width=self.width)

    def flush(self) -> None:
        """Hand over what is buffered; the outcome stands in `output_error`."""
        if self.out is not None and self.output_error is None:
            try:
                self.out.flush()
            except (OSError, ValueError) as error:
                self._lost(error)

    def _write(self, text: str) -> None:
        if self.out is None or self.output_error is not None:
            return
        try:
            self.out.write(plainly(text) if self._plain_out else text)
        except (OSError, ValueError) as error:
            self._lost(error)

    def _lost(self, error: OSError | ValueError) -> None:
        """Standard output takes no more: keep Python from complaining at its end."""
        self.output_error = error if isinstance(error, OSError) else OSError(str(error))
        with suppress(OSError, ValueError, AttributeError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.out.fileno())  # type: ignore[union-attr]
            os.close(null)

    # ------------------------------------------------------------ one document, whatever happens

    def _guard(self) -> None:
        """Send everything else that is written to standard output to standard error."""
        self._saved = self.out
        if _descriptor(self.out) == 1:
            with suppress(OSError):
                assert self.out is not None
                self.out.flush()
                kept = os.dup(1)
                os.dup2(_descriptor(self.err) or os.open(os.devnull, os.O_WRONLY), 1)
                self.out = os.fdopen(kept, "w", encoding="utf-8", errors=PLAIN_ERRORS)
                self._guarded_fd = True
                return
        sys.stdout = self.err if self.err is not None else sys.stdout

    def _unguard(self) -> None:
        if not self._guarded_fd:
            sys.stdout = self._saved
            return
        _flush_c()
        with suppress(OSError, ValueError):
            if sys.stdout is not None:
                sys.stdout.flush()
        with suppress(OSError, ValueError):
            assert self.out is not None
            os.dup2(self.out.fileno(), 1)
            self.out.close()
        self.out = self._saved


def painted(style: str, text: str) -> str:
    """`text` in colour; as it is in a style nobody knows."""
    known = STYLES.get(style)
    return f"\x1b[{known}m{text}\x1b[0m" if known and text else text


def colorful(stream: IO[str] | None) -> bool:
    """Whether a person sees colours there: see https://no-color.org and FORCE_COLOR."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return is_terminal(stream) and os.environ.get("TERM") != "dumb"


def plain_terminal(stream: IO[str] | None) -> bool:
    """Whether a person looks at the stream by a terminal that draws no boxes."""
    return is_terminal(stream) and draws_no_boxes(os.environ.get("TERM", ""))


def is_terminal(stream: IO[str] | None) -> bool:
    """Whether a person looks at the stream."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:
        return False


def _descriptor(stream: IO[str] | None) -> int | None:
    try:
        return stream.fileno() if stream is not None else None
    except (OSError, ValueError, AttributeError):
        return None


def _flush_c() -> None:
    """Hand over what an extern's C has printed but not written yet."""
    if "ctypes" in sys.modules:  # what runs C has loaded it
        sys.modules["ctypes"].CDLL(None).fflush(None)
