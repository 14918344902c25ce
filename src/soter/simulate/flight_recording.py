"""What a program of `soter build --target posix` recorded of its flight (`--record FILE`).

Purpose: the states after all instants, in order, and how late decision modules were. A recording
of something else, or that contradicts itself, is SoterError; one whose end is missing, or of which
instants are, is read up to there.
Non-goals: writing one (`runtime/posix/soter_posix_log.c`), what is told of it (`run_observer.py`).
"""

from __future__ import annotations

import hashlib
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.layout import NEVER, state_layout
from soter.diagnostics.diagnostic import SoterError, mistake, reason
from soter.language.load.named_files import opened
from soter.report.printable_text import visible
from soter.targets.posix_package import FIRST_LINE, head_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO

    import numpy.typing as npt

    from soter.language.model.system import System
    from soter.simulate.run_observer import Observer

    Looks = Mapping[tuple[int, str], tuple[int, int]]
    """Of steps of a DM, by time (ns) and module: how late it began, and ended, ns."""

HEAD_MAX = 1 << 20
END = re.compile(rb"end (\d{20}) ([0-9a-f]{64})\n")
END_BYTES = 4 + 20 + 1 + 64 + 1
BLOCK = 1024
READ_BYTES = 1 << 20
CUT = "its end is missing: the program that flew was killed, or the file was cut"


@dataclass
class FlightRecording:
    """A recording of a system, whose beginning was read.

    `cut`: why it was not read to its end, "" where it was. `misses`: of the trusted part, as the
    driver counted them. `last_ns`: the time of the last instant that was read.
    """

    path: Path
    system: System
    seed: int = 0
    cut: str = ""
    misses: int = 0
    last_ns: int = 0
    _looks: dict[tuple[int, str], tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """SoterError D006 for what is no recording, D023 for one of something else."""
        self._layout = state_layout(self.system)
        modules = max(len(self.system.modules), 1)
        self._record = np.dtype(
            [
                ("number", "<u8"),
                *((name, "<i8") for name in ("ct", "wake_ns", "done_ns", "independent_ns")),
                *((name, "<u4") for name in ("misses", "modes")),
                *((name, "<i8", (modules,)) for name in ("late_ns", "done_by_module_ns")),
                ("state", "u1", (self._layout.size,)),
            ]
        )
        with self._opened() as file:
            self.seed = self._head(file)

    def observed_by(self, observer: Observer, also: Callable[..., None] | None = None) -> None:
        """Show all states to an observer; `also` is then given the `Looks` of its states.

        SoterError D006 where the recording contradicts itself, or has a state that is none.
        """
        if also is not None:
            observer.also = partial(also, looks=self._looks)
        for rows in self._blocks():
            try:
                observer.see(rows)
            except (ValueError, LookupError) as error:
                why = f"up to {self.last_ns} ns a state is none: {error}"
                raise self._unreadable(f"it is damaged: {why}") from error

    # ------------------------------------------------------------ the file

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        try:
            with opened(self.path) as file:
                yield file
        except OSError as error:
            raise self._unreadable(reason(error)) from error

    def _head(self, file: BinaryIO) -> int:
        """Reads what flew, and compares it; the seed."""
        head, _, _ = file.read(HEAD_MAX).partition(b"\n\n")
        file.seek(len(head) + 2)
        first, *lines = head.decode("utf-8", "replace").split("\n")
        if first != FIRST_LINE:
            raise self._unreadable("it does not begin as a recording does")
        said = dict(line.partition("=")[::2] for line in lines)
        seed, own = said.pop("seed", ""), head_of(self.system, self._layout)
        for name in sorted(own.keys() | said.keys()):
            was, here = said.get(name, "the default"), own.get(name, "the default")
            if was != here:
                what = visible(name.removeprefix("param "))
                raise self._of_another(f"{what} was {visible(was)[:80]} in it, and is {here} here")
        if not seed.isdecimal():
            raise self._unreadable("it does not say its seed")
        return int(seed)

    def _blocks(self) -> Iterator[npt.NDArray[np.uint8]]:
        """States, (n, size) bytes, up to where something is missing."""
        with self._opened() as file:
            self._head(file)
            begin, said, size = file.tell(), self._end(file), self._record.itemsize
            file.seek(begin)
            number = 0
            while data := file.read(size * BLOCK):
                records = np.frombuffer(data[: len(data) // size * size], dtype=self._record)
                whole = self._in_order(records, number)
                number += len(whole)
                if len(whole):
                    yield self._told(whole)
                if len(whole) < len(records):
                    missing = int(records["number"][len(whole)]) - number
                    self.cut = self._missing(missing)
                    return
        if said is None:
            self.cut = CUT
        elif said < number:
            raise self._unreadable("it is damaged: it has more instants than its end says")
        elif said > number:
            self.cut = self._missing(said - number)

    def _end(self, file: BinaryIO) -> int | None:
        """How many instants it says it has; None where its end is missing. The hash is compared."""
        begin = file.tell()
        size = file.seek(0, 2)
        file.seek(max(size - END_BYTES, begin))
        end = END.fullmatch(file.read())
        if end is None or (size - END_BYTES - begin) % self._record.itemsize:
            return None
        file.seek(0)
        digest, left = hashlib.sha256(), size - END_BYTES
        while left and (data := file.read(min(left, READ_BYTES))):
            digest.update(data)
            left -= len(data)
        if digest.hexdigest().encode() != end[2]:
            raise self._unreadable("it is damaged: its end has the hash of something else")
        return int(end[1])

    def _in_order(self, records: npt.NDArray[Any], number: int) -> npt.NDArray[Any]:
        """The records up to the first one that is not the next; SoterError D006 for wrong ones."""
        numbers = records["number"].astype(np.int64)
        due = np.arange(number, number + len(records))
        fits = numbers == due
        whole = records[: len(records) if fits.all() else int(np.argmin(fits))]
        cts = whole["state"][:, :8].copy().view("<i8")[:, 0]
        times = np.concatenate(([self.last_ns if number else -1], whole["ct"]))
        backwards = len(whole) < len(records) and numbers[len(whole)] < due[len(whole)]
        if backwards or (np.diff(times) <= 0).any() or (cts != whole["ct"]).any():
            raise self._unreadable(f"it is damaged: instants behind {times[-1]} ns in no order")
        return whole

    def _told(self, records: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
        """The states of records, of which the rest is noted."""
        self.misses += int(records["misses"].sum())
        self.last_ns = int(records["ct"][-1])
        self._looks.clear()
        for m in self.system.modules:
            late, done = (records[name][:, m.index] for name in ("late_ns", "done_by_module_ns"))
            for row in np.flatnonzero(late != NEVER):
                key = int(records["ct"][row]), m.name
                self._looks[key] = int(late[row]), int(done[row])
        return np.ascontiguousarray(records["state"])

    def _missing(self, count: int) -> str:
        are = "instants are" if count != 1 else "instant is"
        return (
            f"{count:,} {are} missing behind {self.last_ns / 1e9:.9g} s: the logger of the program "
            "had no room for more"
        )

    def _unreadable(self, why: str) -> SoterError:
        helps = ("`--record FILE` of a program of `soter build --target posix` writes one",)
        text = f"cannot read the recording `{visible(str(self.path))}`: {why}"
        return mistake("D006", text, *helps)

    def _of_another(self, why: str) -> SoterError:
        helps = ("the same program, system and parameters as were built, by the same Soter",)
        text = f"`{visible(str(self.path))}` is of another flight: {why}"
        return mistake("D023", text, *helps)
