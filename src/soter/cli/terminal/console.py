"""Writes the output of a command: to which stream, in which characters and figures, how far it is.

Purpose: `Console` writes results to standard output and everything else to standard error, in
colour only where a person looks; with `--json` one document and nothing else reaches standard
output, whatever an extern prints; a closed pipe ends quietly, a full disk with a sentence. Where an
encoding or a terminal lacks characters it writes plain ones (`->` for an arrow). `rate_text`,
`memory_text`: figures with a unit. `LineOfProgress` rewrites, after two seconds on a terminal, one
line on standard error that is gone at the end; where standard error is a log, it writes a new line
every ten seconds.
Non-goals: what is said; the process in which externs run (`child_process.py`); times
(`language/model/types.py`).
"""

from __future__ import annotations

import codecs
import io
import math
import os
import re
import shutil
import sys
import time
from contextlib import AbstractContextManager, ExitStack, suppress
from threading import Event, Thread
from typing import IO, TYPE_CHECKING

from soter.diagnostics.current_phase import lasting, listening_to_phases
from soter.diagnostics.legible_text import legible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import TracebackType
    from typing import NoReturn

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.report.tables import Entry


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
    **dict.fromkeys("\u00d7\u2717", "x"),
    **dict.fromkeys("\u00b5\u03bc", "u"),
    **dict.fromkeys("\u2018\u2019", "'"),
    **dict.fromkeys("\u201c\u201d", '"'),
    "\u2192": "->",
    "\u2190": "<-",
    "\u2194": "<->",
    "\u21d2": "=>",
    "\u2264": "<=",
    "\u2265": ">=",
    "\u2260": "!=",
    "\u2248": "~",
    "\u221e": "inf",
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
    "\u00a0": " ",
    "\u2713": "ok",
}
"""Character -> plain text that stands for it; any other that cannot be written becomes `?`."""
_TABLE = str.maketrans(PLAIN)
PLAIN_ERRORS = "soter.plain"
TERMS = re.compile(r"(dumb|unknown|ansi|cons25|vt(52|1\d\d|2\d\d))(-.*)?")


def plain_text(text: str) -> str:
    """The text with every character in PLAIN replaced by plain ones."""
    return text.translate(_TABLE)


def _replace_unencodable(error: UnicodeError) -> tuple[str, int]:
    """Plain text for characters that an encoding lacks; this handles errors of a codec."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(PLAIN.get(char, "?") for char in missing), error.end


codecs.register_error(PLAIN_ERRORS, _replace_unencodable)


def _text_in_units(x: float, step: int, units: Sequence[str], plain: str) -> str:
    """`x` with three digits in the largest unit that it reaches; `plain` if it reaches none."""
    for k, unit in enumerate(units):
        factor = step ** (len(units) - k)
        if x >= 0.9995 * factor:
            return f"{x / factor:.{3 if x < 999.5 * factor else 4}g} {unit}"
    return plain


def rate_text(x: float) -> str:
    """A rate with three digits and a unit: `1.4 M`, `23 k`, `840`."""
    return _text_in_units(x, 1000, ("G", "M", "k"), f"{x:.0f}")


def memory_text(count: int) -> str:
    """A number of bytes in units of 1024: `9.6 MB`."""
    return _text_in_units(count, 1024, ("GB", "MB", "kB"), f"{count} bytes")


def disk_size_text(count: int) -> str:
    """A number of bytes on a disk in units of 1000: `481 MB`."""
    return _text_in_units(count, 1000, ("GB", "MB", "kB"), f"{count} bytes")


class ChildResult(Exception):  # noqa: N818 - no error: the command was done, in the child
    """The result of a child process: its text for standard output, and its exit code."""

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(exit_code)
        self.text = text
        self.exit = exit_code


STYLES = {"bold": "1", "muted": "2", "red": "1;31", "green": "1;32", "yellow": "1;33", "blue": "34"}


class Console:
    """The two output streams of one command; a context that restores `sys.stdout` at its end."""

    def __init__(self, *, json: bool, own_process: bool = False) -> None:
        self.json, self.words = json, list[str]()
        self.own_process = own_process
        """Whether this process is the command, not another program that calls `main`."""

        self.of_program: tuple[Diagnostic, ...] = ()
        """What was found in the program that the command is about, to be told however it ends."""
        self._leave: Callable[[str, int], NoReturn] | None = None
        self._during = ExitStack()
        self.out: IO[str] | None = sys.stdout
        self.err: IO[str] | None = sys.stderr
        self._shown_on = self.out
        self._plain_out = self._plain_err = False
        self.output_error: OSError | None = None
        """Why standard output took no more; `main` does not report a closed pipe as an error."""
        self._saved: IO[str] | None = None
        self._guarded_fd = False

    def __enter__(self) -> Console:  # noqa: PYI034 - typing.Self came with Python 3.11
        for stream in (self.out, self.err):
            with suppress(AttributeError, ValueError, OSError):
                stream.reconfigure(errors=PLAIN_ERRORS)  # type: ignore[union-attr]
        self.color_out = shows_colors(self.out)
        self.color_err = shows_colors(self.err)
        self._plain_out, self._plain_err = is_plain_terminal(self.out), is_plain_terminal(self.err)
        self.ascii_only = self._plain_out or (
            not (getattr(self.out, "encoding", None) or "ascii").lower().startswith("utf")
        )
        if self.json:
            self._redirect_standard_output()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._during.close()
        if self._saved is not None:
            self._restore_standard_output()

    def enter_until_end(self, context: AbstractContextManager[None]) -> None:
        """Enters a context that lasts as long as the command."""
        self._during.enter_context(context)

    def listen_to_signals(self) -> None:
        """Makes Ctrl-C, SIGTERM and SIGHUP only ask to stop, so that results are kept."""
        from soter.simulate.interrupt import (  # noqa: PLC0415 - NumPy
            ANY_END,
            StopRequest,
            receiving_signals,
        )

        self.enter_until_end(receiving_signals(StopRequest(), ANY_END))

    # ------------------------------------------------------------ a child that prints nothing

    def keep_output_for(self, leave: Callable[[str, int], NoReturn]) -> None:
        """Collects output from now on; `leave` will pass it to the parent, which prints it."""
        self._leave = leave
        self.out = io.StringIO()
        self._plain_out = False  # the parent writes plain characters where they are needed

    def hand_over_output(self, exit_code: int) -> None:
        """In a child, leaves the output for the parent and ends; elsewhere it does nothing."""
        if self._leave is not None:
            assert isinstance(self.out, io.StringIO)
            _flush_c()
            self._leave(self.out.getvalue(), exit_code)

    # ------------------------------------------------------------ writing

    def say(self, text: str = "") -> None:
        """Writes a line of the result for people; writes nothing with `--json`."""
        if not self.json:
            self.write(legible(text, color=self.color_out, words=self.words) + "\n")

    def write_document(self, text: str) -> None:
        """Writes the document: JSON, or a format of continuous integration."""
        self.write(text + "\n")

    def note(self, text: str) -> None:
        """Writes to standard error a line that is not part of the result."""
        if self.err is not None:
            text = legible(text, color=self.color_err, words=self.words)
            with suppress(OSError, ValueError):
                self.err.write((plain_text(text) if self._plain_err else text) + "\n")
                self.err.flush()

    def write_diagnostics(self, items: tuple[Diagnostic, ...]) -> None:
        """Writes diagnostics for people to standard error; writes nothing with `--json`."""
        if items and not self.json:
            from soter.diagnostics.render import render_all  # noqa: PLC0415 - only for diagnostics

            self.note(render_all(items, color=self.color_err))

    def paint(self, style: str, text: str) -> str:
        """`text` in a style of STYLES if standard output shows colours; else unchanged."""
        return painted(style, text) if self.color_out else text

    @property
    def width(self) -> int | None:
        """The columns of the terminal, or of $COLUMNS; None if both are unknown."""
        if not os.environ.get("COLUMNS", "").isdigit() and not is_terminal(self._shown_on):
            return None
        return max(shutil.get_terminal_size((80, 24)).columns, 20)

    def table(self, headers: Sequence[str], rows: Iterable[Sequence[Entry]]) -> str:
        """The text of a table, in colour, and no wider than the terminal if possible."""
        from soter.report.tables import table  # noqa: PLC0415 - needs NumPy

        return table(headers, rows, color=self.color_out, width=self.width)

    def flush(self) -> None:
        """Flushes standard output; keeps an error in `output_error`."""
        if self.out is not None and self.output_error is None:
            try:
                self.out.flush()
            except (OSError, ValueError) as error:
                self._note_lost_output(error)

    def write(self, text: str) -> None:
        """Writes text, such as a child's output, unchanged to standard output."""
        if self.out is None or self.output_error is not None:
            return
        try:
            self.out.write(plain_text(text) if self._plain_out else text)
        except (OSError, ValueError) as error:
            self._note_lost_output(error)

    def _note_lost_output(self, error: OSError | ValueError) -> None:
        """Notes that standard output fails, and stops Python from complaining at exit."""
        self.output_error = error if isinstance(error, OSError) else OSError(str(error))
        with suppress(OSError, ValueError, AttributeError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.out.fileno())  # type: ignore[union-attr]
            os.close(null)

    # ------------------------------------------------------------ one document, whatever happens

    def _redirect_standard_output(self) -> None:
        """Sends what other code writes to standard output to standard error instead."""
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

    def _restore_standard_output(self) -> None:
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
    """`text` in a style of STYLES; unchanged if there is no such style."""
    known = STYLES.get(style)
    return f"\x1b[{known}m{text}\x1b[0m" if known and text else text


def shows_colors(stream: IO[str] | None) -> bool:
    """Whether a stream shows colours: NO_COLOR or FORCE_COLOR decides, else a terminal does."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return is_terminal(stream) and os.environ.get("TERM") != "dumb"


def is_plain_terminal(stream: IO[str] | None) -> bool:
    """Whether the stream is a terminal that cannot draw boxes."""
    return is_terminal(stream) and TERMS.fullmatch(os.environ.get("TERM", "")) is not None


def is_terminal(stream: IO[str] | None) -> bool:
    """Whether the stream is a terminal."""
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
    """Flushes the output buffers of C, which hold what externs have printed."""
    if "ctypes" in sys.modules:  # code that runs C has loaded it
        sys.modules["ctypes"].CDLL(None).fflush(None)


PATIENCE_S = 2.0
EVERY_S = 0.1
EVERY_S_OF_A_LOG = 10.0
WIDTH = 30
CLEAR = "\r\x1b[K"


def clipped_line(text: str) -> str:
    """The text cut to one line of the terminal, as only one line can be cleared."""
    most = max(shutil.get_terminal_size((80, 24)).columns - 1, 20)
    return text if len(text) <= most else f"{text[: most - 3]}..."


class LineOfProgress:
    """A context that gives a function to call with texts about the progress of a command."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._began = self._next = time.perf_counter()
        self._next += PATIENCE_S
        self._shown = False
        self._text = ""
        self._left = Event()
        self._logging: Thread | None = None

    def __enter__(self) -> Callable[[str], None] | None:
        self._begin_logging()
        return None if self._console.err is None else self._show_text

    def __exit__(self, *_: object) -> None:
        if self._logging is not None:
            self._left.set()
            self._logging.join()
        if self._shown:
            self._write_line(CLEAR)

    def _begin_logging(self) -> None:
        err = self._console.err
        if err is not None and not is_terminal(err):
            self._logging = Thread(target=self._write_log, name="soter progress", daemon=True)
            self._logging.start()

    def _write_log(self) -> None:
        """Writes a line to the log at fixed intervals until the context is left."""
        while not self._left.wait(EVERY_S_OF_A_LOG):
            spent = f"soter: {time.perf_counter() - self._began:.0f} s"
            self._write_line("  ".join(x for x in (spent, self._progress_text()) if x) + "\n")

    def _progress_text(self) -> str:
        """The text about the progress."""
        return self._text

    def _show_text(self, text: str) -> None:
        self._text = text
        if self._is_time_to_rewrite():
            self._write_line(CLEAR + clipped_line(text))

    def _is_time_to_rewrite(self) -> bool:
        """Whether to rewrite the line now; False if standard error is no terminal."""
        now = time.perf_counter()
        if self._logging is not None or now < self._next:
            return False
        self._next = now + EVERY_S
        self._shown = True
        return True

    def _write_line(self, text: str) -> None:
        assert self._console.err is not None
        with suppress(OSError, ValueError):
            self._console.err.write(text)
            self._console.err.flush()


class ProgressBar(LineOfProgress):
    """A context that gives a function to call with the share done; shows bar, phase and time left.

    The share is shown from the first one above 0 until it is 1. It never falls, unless a phase with
    another name begins anew. The time left never rises: while the estimate is above the last time
    shown, no time is shown.
    """

    def __init__(self, console: Console, *, timed: bool = True) -> None:
        """Shows the time left only if `timed`, which means that equal shares take equal times."""
        super().__init__(console)
        self._timed = timed
        self._phase = ""
        self._furthest = 0.0
        self._share_began = self._phase_began = self._told_s = self._began
        self._left_s = math.inf
        self._during = ExitStack()

    def __enter__(self) -> Callable[[float], None] | None:  # type: ignore[override]
        self._begin_logging()
        if self._console.err is None:
            return None
        self._during.enter_context(listening_to_phases(self._enter_phase, self._announce))
        return self._show_share

    def __exit__(self, *_: object) -> None:
        self._during.close()
        super().__exit__()

    def _announce(self, line: str) -> None:
        self._write_line(f"{CLEAR if self._shown else ''}soter: {line}\n")

    def _enter_phase(self, name: str, anew: bool) -> None:
        if name != self._phase:
            self._phase_began = time.perf_counter()
            if anew:
                self._furthest, self._share_began = 0.0, self._phase_began
                self._left_s = math.inf
        self._phase = name
        self._rewrite_line_if_due()

    def _show_share(self, share: float) -> None:
        if share > self._furthest:
            self._furthest, self._told_s = min(share, 1.0), time.perf_counter()
        self._rewrite_line_if_due()

    def _rewrite_line_if_due(self) -> None:
        if self._is_time_to_rewrite():
            self._write_line(CLEAR + self._line_text())

    def _line_text(self) -> str:
        words = self._progress_text()
        if not 0.0 < self._furthest < 1.0:
            return clipped_line(words)
        full = int(self._furthest * WIDTH)
        fill, rest = ("#", "-") if self._console.ascii_only else ("━", "╌")
        return clipped_line(f"{fill * full}{rest * (WIDTH - full)}  {words}")

    def _progress_text(self) -> str:
        share = f"{self._furthest:4.0%}" if 0.0 < self._furthest < 1.0 else ""
        since = f"{time.perf_counter() - self._phase_began:.0f} s"
        in_a_log = "" if self._logging is not None else since  # lines of a log have it in front
        doing = f"{self._phase}, {since}" if self._phase else in_a_log
        return "  ".join(p for p in (share, self._time_left_text(), doing) if p).strip()

    def _time_left_text(self) -> str:
        """The time left as text, estimated from the last share; "" if no estimate is possible."""
        share, now = self._furthest, time.perf_counter()
        if not (self._timed and 0.001 < share < 1.0):
            return ""
        left_s = (self._told_s - self._share_began) * (1.0 / share - 1.0) - (now - self._told_s)
        if left_s <= 0.0 or left_s > self._left_s:
            return ""
        self._left_s = left_s
        return f"{lasting(left_s)} left"
