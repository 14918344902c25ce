"""Both engines under a driver that chooses: any order of steps, any answer to what they ask.

Purpose: fire components in C (`soter_fire`) and in the interpreter (`Interpreter.fire`) in the same
random order with the same random picks, and compare every state after every step.
Non-goals: schedules that a calendar allows (`explore/`): a step may come at any time here.
"""

from __future__ import annotations

import random
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from generators.engine_comparison import first_difference
from soter.semantics.answered_draws import AnsweredDraws
from soter.semantics.draws import fnv1a_64
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import environment_input
from soter.simulate.run import state_bytes

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from generators.engine_comparison import Subject

    Bytes = npt.NDArray[np.uint8]

ROOM = 48
BRANCH_WORDS = 4
DECLARATIONS = """
typedef struct { uint64_t stream; uint32_t count; uint32_t pick; } soter_choice;
typedef struct {
  soter_choice *choices; uint32_t room, given; uint32_t *taken; uint64_t *branches;
} soter_answers;
typedef struct {
  int64_t every_ns; void (*draw)(void *state, const void *answer);
} soter_input_info;
typedef struct {
  const char *name; const char *hash; size_t state_size;
  uint32_t components, modules, properties, topics, inputs;
  const void *component; const void *module; const void *property; const void *topic;
  const soter_input_info *input;
  void *init;
} soter_program;
void soter_start_with(const soter_program *p, void *state, uint64_t seed, const void *answer);
uint32_t soter_fire(const soter_program *p, void *state, uint32_t component, const void *answer);
"""


def _ffi() -> Any:
    """Whose types nobody knows."""
    return FFI()


class Native:
    """The C engine, one step at a time; every step is answered with random picks."""

    def __init__(self, library: Path, s: Subject, chance: random.Random) -> None:
        self.ffi = _ffi()
        self.ffi.cdef(DECLARATIONS)
        self.ffi.cdef(f"extern soter_program {s.name}_program;")
        self.lib = self.ffi.dlopen(str(library))
        self.program = self.ffi.addressof(self.lib, f"{s.name}_program")
        self.state = np.zeros(s.layout.size, dtype=np.uint8)
        self.chance = chance
        self._choices = self.ffi.new("soter_choice[]", ROOM)
        self._taken = self.ffi.new("uint32_t *")
        self._answers = self.ffi.new("soter_answers *")
        self._branches = self.ffi.new("uint64_t[]", BRANCH_WORDS)

    @property
    def _pointer(self) -> Any:
        return self.ffi.cast("void *", self.state.ctypes.data)

    def _answer(self) -> Any:
        self._taken[0] = 0
        for i in range(ROOM):
            self._choices[i].pick = self.chance.choice((0, 0, 1, 1, 2, 3, 7))
        given = self.chance.choice((0, ROOM, ROOM))
        self._answers[0] = (self._choices, ROOM, given, self._taken, self._branches)
        return self._answers

    @property
    def branches(self) -> set[int]:
        """Numbers of the branches that were taken so far."""
        words = list(self._branches)
        return {i for i in range(64 * BRANCH_WORDS) if words[i // 64] >> i % 64 & 1}

    def asked(self) -> list[tuple[int, int, int]]:
        """What the last step asked: stream, count, pick."""
        known = min(int(self._taken[0]), ROOM)
        return [(c.stream, c.count, c.pick) for c in (self._choices[i] for i in range(known))]

    def start(self, seed: int) -> None:
        """The initial configuration."""
        self.lib.soter_start_with(self.program, self._pointer, seed, self._answer())

    def at(self, ct: int) -> None:
        """Time is a driver's."""
        self.state.view(np.int64)[0] = ct

    def fire(self, component: int) -> None:
        """One step."""
        self.lib.soter_fire(self.program, self._pointer, component, self._answer())

    def draw(self, number: int) -> None:
        """One change of an input."""
        self.program.input[number].draw(self._pointer, self._answer())


class Replay:
    """Answers of the interpreter: what C was answered, stream by stream in order."""

    def __init__(self) -> None:
        self.left: dict[int, deque[tuple[int, int]]] = {}

    def load(self, asked: list[tuple[int, int, int]]) -> None:
        """The next step's."""
        self.left = {}
        for stream, count, pick in asked:
            self.left.setdefault(stream, deque()).append((count, pick))

    def __call__(self, stream: str, count: int) -> int:
        queue = self.left.get(fnv1a_64(stream))
        if not queue:
            return 0
        expected, pick = queue.popleft()
        assert count == expected, f"{stream}: {count} alternatives, {expected} in C"
        return pick


def first_disagreement(s: Subject, library: Path, steps: int) -> str | None:
    """What first differs after some step, in words; None where nothing does."""
    chance = random.Random(s.seed)  # noqa: S311 - not for secrets
    native, replay = Native(library, s, chance), Replay()
    draws = AnsweredDraws(s.system, replay, s.seed)
    interpreter = Interpreter(s.system, s.seed, draws=draws)
    native.start(s.seed)
    replay.load(native.asked())
    c, record = interpreter.initial(), interpreter.record()
    ct, components = 0, s.system.components
    for number in range(steps):
        ct += chance.choice((0, 0, 0, 1, 999, 1_000_000, 2_500_000, 10_000_000))
        due = _may_fire(s, ct, chance)
        native.at(ct)
        c = replace(c, ct=ct)
        if due is None:
            drive = chance.randrange(len(s.system.inputs))
            native.draw(drive)
            replay.load(native.asked())
            item = s.system.inputs[drive]
            value = interpreter.drawn_input(item, ct)
            c = environment_input(interpreter.machine, c, item.topic, value)
            what = f"input {drive}"
        else:
            n = components[due]
            if n.plant is not None:  # a plant moves at its releases only
                ct = n.phase_ns + -(-max(ct - n.phase_ns, 0) // n.period_ns) * n.period_ns
                native.at(ct)
            native.fire(due)
            replay.load(native.asked())
            c, event = interpreter.fire(replace(c, ct=ct, FN=(due,)), due)
            record.note_event(event, ct)
            what = f"{n.role} {n.name}"
        other = np.frombuffer(state_bytes(s.system, s.layout, c, record, s.seed), dtype=np.uint8)
        words = _difference(s, native.state, other)
        if words:
            return f"step {number}, {what} at {ct} ns:\n{words}"
    return None


def _may_fire(s: Subject, ct: int, chance: random.Random) -> int | None:
    """A component that may step at this time, or None for an input."""
    ready = [n.index for n in s.system.components if n.plant is not None or n.phase_ns <= ct]
    if s.system.inputs and (not ready or chance.random() < 0.1):
        return None
    return chance.choice(ready) if ready else 0


def _difference(s: Subject, native: Bytes, other: Bytes) -> str:
    """Members that differ, but for those that belong to a calendar."""
    states = []
    for raw in (native, other):
        own = raw.copy().reshape(1, -1)
        view: Any = own.view(s.dtype)[0]
        view["components"]["next"] = 0
        view["components"]["pending"] = 0
        view["header"]["reserved"] = 0
        states.append(own)
    return first_difference(s, *states) or ""
