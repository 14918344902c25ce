"""A line that says how far a run is.

Purpose: on a terminal, for anything over two seconds, one line on standard error that is
rewritten and gone at the end; where standard error is a log, a new line every ten seconds.
Non-goals: standard output, which the result has to itself.
"""

from __future__ import annotations

import math
import shutil
import time
from contextlib import ExitStack, suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

from soter.cli.terminal.console import is_terminal
from soter.diagnostics.current_phase import lasting, listening_to_phases

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.cli.terminal.console import Console

PATIENCE_S = 2.0
EVERY_S = 0.1
EVERY_S_OF_A_LOG = 10.0
WIDTH = 30
CLEAR = "\r\x1b[K"


def clipped(text: str) -> str:
    """What fits on one line: a longer one could not be taken back."""
    most = max(shutil.get_terminal_size((80, 24)).columns - 1, 20)
    return text if len(text) <= most else f"{text[: most - 3]}..."


class LineOfProgress:
    """Called with a text that says how far it is; a context, which clears the line when left.

    Off a terminal a thread writes the last text at fixed intervals, whether or not it is another.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._began = self._next = time.perf_counter()
        self._next += PATIENCE_S
        self._shown = False
        self._text = ""
        self._left = Event()
        self._logging: Thread | None = None

    def __enter__(self) -> Callable[[str], None] | None:
        self._begin()
        return None if self._console.err is None else self._show

    def __exit__(self, *_: object) -> None:
        if self._logging is not None:
            self._left.set()
            self._logging.join()
        if self._shown:
            self._write(CLEAR)

    def _begin(self) -> None:
        err = self._console.err
        if err is not None and not is_terminal(err):
            self._logging = Thread(target=self._log, name="soter progress", daemon=True)
            self._logging.start()

    def _log(self) -> None:
        """Write a line again and again until the context is left."""
        while not self._left.wait(EVERY_S_OF_A_LOG):
            spent = f"soter: {time.perf_counter() - self._began:.0f} s"
            self._write("  ".join(x for x in (spent, self._so_far()) if x) + "\n")

    def _so_far(self) -> str:
        """How far it is, for a log."""
        return self._text

    def _show(self, text: str) -> None:
        self._text = text
        if self._is_time():
            self._write(CLEAR + clipped(text))

    def _is_time(self) -> bool:
        """Whether to write now, on a terminal."""
        now = time.perf_counter()
        if self._logging is not None or now < self._next:
            return False
        self._next = now + EVERY_S
        self._shown = True
        return True

    def _write(self, text: str) -> None:
        assert self._console.err is not None
        with suppress(OSError, ValueError):
            self._console.err.write(text)
            self._console.err.flush()


class ProgressBar(LineOfProgress):
    """Called with the share that is done: a bar, what is being done and for how long, what is left.

    A share is shown where it says something: not before the first one, and not once all is done
    that is counted. It never falls, unless a phase that begins anew has another name; what is left
    never rises: where it turns out to be more than was said nothing is said of it.
    """

    def __init__(self, console: Console, *, timed: bool = True) -> None:
        """`timed`: equal shares take about as long; else nothing follows of what is left."""
        super().__init__(console)
        self._timed = timed
        self._phase = ""
        self._furthest = 0.0
        self._share_began = self._phase_began = self._told = self._began
        self._left_s = math.inf
        self._during = ExitStack()

    def __enter__(self) -> Callable[[float], None] | None:  # type: ignore[override]
        self._begin()
        if self._console.err is None:
            return None
        self._during.enter_context(listening_to_phases(self._enter_phase, self._announce))
        return self._show_share

    def __exit__(self, *_: object) -> None:
        self._during.close()
        super().__exit__()

    def _announce(self, line: str) -> None:
        self._write(f"{CLEAR if self._shown else ''}soter: {line}\n")

    def _enter_phase(self, name: str, anew: bool) -> None:
        if name != self._phase:
            self._phase_began = time.perf_counter()
            if anew:
                self._furthest, self._share_began = 0.0, self._phase_began
                self._left_s = math.inf
        self._phase = name
        self._show_now()

    def _show_share(self, share: float) -> None:
        if share > self._furthest:
            self._furthest, self._told = min(share, 1.0), time.perf_counter()
        self._show_now()

    def _show_now(self) -> None:
        if self._is_time():
            self._write(CLEAR + self._line())

    def _line(self) -> str:
        words = self._so_far()
        if not 0.0 < self._furthest < 1.0:
            return clipped(words)
        full = int(self._furthest * WIDTH)
        fill, rest = ("#", "-") if self._console.ascii_only else ("━", "╌")
        return clipped(f"{fill * full}{rest * (WIDTH - full)}  {words}")

    def _so_far(self) -> str:
        share = f"{self._furthest:4.0%}" if 0.0 < self._furthest < 1.0 else ""
        since = f"{time.perf_counter() - self._phase_began:.0f} s"
        in_a_log = "" if self._logging is not None else since  # whose lines begin with the time
        doing = f"{self._phase}, {since}" if self._phase else in_a_log
        return "  ".join(p for p in (share, self._remaining(), doing) if p).strip()

    def _remaining(self) -> str:
        """How long it may still take, reckoned when the last share was told."""
        share, now = self._furthest, time.perf_counter()
        if not (self._timed and 0.001 < share < 1.0):
            return ""
        left_s = (self._told - self._share_began) * (1.0 / share - 1.0) - (now - self._told)
        if left_s <= 0.0 or left_s > self._left_s:
            return ""
        self._left_s = left_s
        return f"{lasting(left_s)} left"
