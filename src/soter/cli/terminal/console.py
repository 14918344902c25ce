"""Where a command's words go.

Purpose: results on standard output, everything else on standard error, colour only where a
person looks; with `--json` one document on standard output and nothing else, whatever an extern
prints; closed pipes and full disks end quietly or with a sentence.
Non-goals: what is said.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from contextlib import ExitStack, suppress
from typing import IO, TYPE_CHECKING

from soter.cli.terminal.ascii import PLAIN_ERRORS, draws_no_boxes, plainly

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from contextlib import AbstractContextManager
    from types import TracebackType

    from soter.cli.terminal.child_result import ResultPipe
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.report.terminal_tables import Entry

STYLES = {"bold": "1", "muted": "2", "red": "1;31", "green": "1;32", "yellow": "1;33", "blue": "34"}


class Console:
    """The two streams of one command. A context: leaving it puts `sys.stdout` back."""

    def __init__(self, *, json: bool, own_process: bool = False) -> None:
        self.json = json
        self.own_process = own_process
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
                os.dup2(_descriptor(self.err) or _null(), 1)
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


def _null() -> int:
    return os.open(os.devnull, os.O_WRONLY)


def _flush_c() -> None:
    """Hand over what an extern's C has printed but not written yet."""
    if "ctypes" in sys.modules:  # what runs C has loaded it
        sys.modules["ctypes"].CDLL(None).fflush(None)
