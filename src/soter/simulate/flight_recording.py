"""Reads a recording that a program of target `posix` wrote of its flight.

Purpose: a `FlightRecording` gives the states after all instants, in order, and how late decision
modules were. A recording of another system, or one that contradicts itself, is a `SoterError`. A
recording without its end, or without some instants, is read up to there.
Non-goals: what writes recordings (`runtime/posix/`), what is told of a run (`run_observer.py`).
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
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import open_finite_file
from soter.report.wording import visible
from soter.targets.posix_package import FIRST_LINE, flight_head

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO

    import numpy.typing as npt

    from soter.language.model.system import System
    from soter.simulate.run_observer import Observer

    StepLateness = Mapping[tuple[int, str], tuple[int, int]]
    """By time (ns) and module of a DM step: how late it began and ended, in ns."""


HEAD_MAX = 1 << 20
END = re.compile(rb"end (\d{20}) ([0-9a-f]{64})\n")
END_BYTES = 4 + 20 + 1 + 64 + 1
BLOCK = 1024
READ_BYTES = 1 << 20
CUT = "its end is missing: the program that flew was killed, or the file was cut"


@dataclass
class FlightRecording:
    """The recording of a flight of a system.

    `cut`: why it was read only in part, "" if it was read to its end. `misses`: how often the
    driver found the trusted part late. `last_ns`: the time of the last instant that was read.
    """

    path: Path
    system: System
    seed: int = 0
    cut: str = ""
    misses: int = 0
    last_ns: int = 0
    _lateness: dict[tuple[int, str], tuple[int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Reads the head; raises `SoterError` D006 for no recording, D023 for another system's."""
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
        with self._open_file() as file:
            self.seed = self._read_head(file)

    def show_states_to(self, observer: Observer, also: Callable[..., None] | None = None) -> None:
        """Shows all states to an observer; `also` then gets the `StepLateness` of these states.

        Raises `SoterError` D006 if the recording contradicts itself or has an impossible state.
        """
        if also is not None:
            observer.also = partial(also, looks=self._lateness)
        for rows in self._read_blocks():
            try:
                observer.observe_states(rows)
            except (ValueError, LookupError) as error:
                why = f"up to {self.last_ns} ns a state is none: {error}"
                raise self._unreadable(f"it is damaged: {why}") from error

    # ------------------------------------------------------------ the file

    @contextmanager
    def _open_file(self) -> Iterator[BinaryIO]:
        try:
            with open_finite_file(self.path) as file:
                yield file
        except OSError as error:
            raise self._unreadable(reason(error)) from error

    def _read_head(self, file: BinaryIO) -> int:
        """Gives the seed; raises SoterError if another system or other parameters were flown."""
        head, _, _ = file.read(HEAD_MAX).partition(b"\n\n")
        file.seek(len(head) + 2)
        first, *lines = head.decode("utf-8", "replace").split("\n")
        if first != FIRST_LINE:
            raise self._unreadable("it does not begin as a recording does")
        fields_of_head = dict(line.partition("=")[::2] for line in lines)
        seed, now = fields_of_head.pop("seed", ""), flight_head(self.system, self._layout)
        for name in sorted(now.keys() | fields_of_head.keys()):
            was, here = (fields_of_head.get(name, "the default"), now.get(name, "the default"))
            if was != here:
                name_shown = visible(name.removeprefix("param "))
                raise self._other_flight(
                    f"{name_shown} was {visible(was)[:80]} in it, and is {here} here"
                )
        if not seed.isdecimal():
            raise self._unreadable("it does not say its seed")
        return int(seed)

    def _read_blocks(self) -> Iterator[npt.NDArray[np.uint8]]:
        """Yields the states in blocks, (n, size) bytes, until a state is missing."""
        with self._open_file() as file:
            self._read_head(file)
            begin, announced, size = file.tell(), self._read_end(file), self._record.itemsize
            file.seek(begin)
            number = 0
            while data := file.read(size * BLOCK):
                records = np.frombuffer(data[: len(data) // size * size], dtype=self._record)
                ordered = self._records_in_sequence(records, number)
                number += len(ordered)
                if len(ordered):
                    yield self._note_records(ordered)
                if len(ordered) < len(records):
                    missing = int(records["number"][len(ordered)]) - number
                    self.cut = self._missing_text(missing)
                    return
        if announced is None:
            self.cut = CUT
        elif announced < number:
            raise self._unreadable("it is damaged: it has more instants than its end says")
        elif announced > number:
            self.cut = self._missing_text(announced - number)

    def _read_end(self, file: BinaryIO) -> int | None:
        """Checks the hash in the end, and gives its number of instants; None without an end."""
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

    def _records_in_sequence(self, records: npt.NDArray[Any], number: int) -> npt.NDArray[Any]:
        """The records up to the first gap in their numbers; `SoterError` D006 for wrong records."""
        numbers = records["number"].astype(np.int64)
        due = np.arange(number, number + len(records))
        fits = numbers == due
        ordered = records[: len(records) if fits.all() else int(np.argmin(fits))]
        cts = ordered["state"][:, :8].copy().view("<i8")[:, 0]
        times = np.concatenate(([self.last_ns if number else -1], ordered["ct"]))
        backwards = len(ordered) < len(records) and numbers[len(ordered)] < due[len(ordered)]
        if backwards or (np.diff(times) <= 0).any() or (cts != ordered["ct"]).any():
            raise self._unreadable(f"it is damaged: instants behind {times[-1]} ns in no order")
        return ordered

    def _note_records(self, records: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
        """Notes the lateness, misses and last time of the records, and gives the states in them."""
        self.misses += int(records["misses"].sum())
        self.last_ns = int(records["ct"][-1])
        self._lateness.clear()
        for module in self.system.modules:
            late, done = (
                records[name][:, module.index] for name in ("late_ns", "done_by_module_ns")
            )
            for row in np.flatnonzero(late != NEVER):
                key = int(records["ct"][row]), module.name
                self._lateness[key] = int(late[row]), int(done[row])
        return np.ascontiguousarray(records["state"])

    def _missing_text(self, count: int) -> str:
        are = "instants are" if count != 1 else "instant is"
        return (
            f"{count:,} {are} missing behind {self.last_ns / 1e9:.9g} s: the logger of the program "
            "had no room for more"
        )

    def _unreadable(self, why: str) -> SoterError:
        helps = ("`--record FILE` of a program of `soter build --target posix` writes one",)
        text = f"cannot read the recording `{visible(str(self.path))}`: {why}"
        return mistake("D006", text, *helps)

    def _other_flight(self, why: str) -> SoterError:
        helps = ("the same program, system and parameters as were built, by the same Soter",)
        text = f"`{visible(str(self.path))}` is of another flight: {why}"
        return mistake("D023", text, *helps)
