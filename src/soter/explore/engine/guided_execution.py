"""Executions that follow a changed trace as far as it goes, many a second.

Purpose: traces as arrays of the engine's records, and the C that makes an execution of one
(`soter_explore_guided_execution.c`) with the configuration after each of its steps.
Non-goals: what to change (`shrink.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.explore.engine.explorer_library import RawChoice, RawStep
from soter.explore.methods import CHOICES_MAX

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from soter.explore.engine.explorer_library import Engine

    Steps = npt.NDArray[np.void]
    """(n,) of `STEP`."""
    Counts = npt.NDArray[np.uint32]
    Configurations = npt.NDArray[np.uint8]

NOBODY = 2**32 - 1
"""`actor` of the start."""
STEPS, SKIPPED, BEGINS, EFFECT, BIRTH = range(5)
"""`kind`, as in `soter_explore_internal.h`."""
CHOICE = np.dtype([("stream", "u8"), ("count", "u4"), ("pick", "u4")], align=True)
STEP = np.dtype(
    [
        ("actor", "u4"),
        ("kind", "u4"),
        ("release", "i8"),
        ("time", "i8"),
        ("choices", "u4"),
        ("choice", CHOICE, (CHOICES_MAX,)),
    ],
    align=True,
)
"""`soter_trace_step`."""


@dataclass(frozen=True)
class GuidedRun:
    """An execution, and whether it ends in the violation that is looked for.

    `steps`: (n,); `unusual`: (n,), how many choices of each are not the default one, its time and
    its loss among them; `configurations`: (n, configuration_size), the configuration after each.
    """

    steps: Steps
    unusual: Counts
    configurations: Configurations
    violates: bool


class Guided:
    """Runs of one engine's system towards one violation."""

    def __init__(self, engine: Engine, seed: int, wanted: tuple[int, int]) -> None:
        self._engine = engine
        self._seed, self._wanted = seed & (2**64 - 1), wanted
        ffi = engine.ffi
        assert STEP.itemsize == ffi.sizeof("soter_trace_step"), STEP
        assert STEP.fields is not None
        assert STEP.fields["choice"][1] == ffi.offsetof("soter_trace_step", "choice"), STEP

    def run(
        self, wish: Steps, limit: int, before: GuidedRun | None = None, begin: int = 0
    ) -> GuidedRun:
        """The execution that follows `wish`, at most `limit` steps.

        The first `begin` steps are those of `before`. (wishes,) -> (steps,)
        """
        begin = begin if before is not None else 0
        made = np.zeros(limit, dtype=STEP)
        unusual = np.zeros(limit, dtype=np.uint32)
        configurations = np.zeros((limit, self._engine.configuration_size), dtype=np.uint8)
        ffi, violates = self._engine.ffi, self._engine.ffi.new("bool *")
        start = ffi.NULL
        if before is not None and begin > 0:
            start = _pointer(ffi, "void *", before.configurations[begin - 1])
        wish = np.ascontiguousarray(wish)
        guide = {
            "seed": self._seed,
            "wanted": {"what": self._wanted[0], "index": self._wanted[1]},
            "wish": _pointer(ffi, "soter_trace_step *", wish),
            "length": len(wish),
            "begin": begin,
            "limit": limit,
            "from": start,
            "made": _pointer(ffi, "soter_trace_step *", made),
            "unusual": _pointer(ffi, "uint32_t *", unusual),
            "configurations": _pointer(ffi, "void *", configurations),
        }
        lib, model = self._engine.lib, self._engine.model
        n = int(lib.soter_explore_guided(model, ffi.new("soter_guide *", guide), violates))
        if before is not None and begin > 0:
            made[:begin] = before.steps[:begin]
            unusual[:begin] = before.unusual[:begin]
            configurations[:begin] = before.configurations[:begin]
        return GuidedRun(made[:n], unusual[:n], configurations[:n], bool(violates[0]))


def _pointer(ffi: Any, kind: str, array: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - cffi
    return ffi.cast(kind, array.ctypes.data)


def array_of(steps: Sequence[RawStep]) -> Steps:
    """(n,): the same steps as records."""
    made = np.zeros(len(steps), dtype=STEP)
    for to, s in zip(made, steps, strict=True):
        to["actor"] = s.actor if s.actor >= 0 else NOBODY
        to["kind"], to["release"], to["time"] = s.kind, s.release_ns, s.time_ns
        to["choices"] = len(s.choices)
        for i, c in enumerate(s.choices):
            to["choice"][i] = (c.stream, c.count, c.pick)
    return made


def steps_of(made: Steps) -> tuple[RawStep, ...]:
    """The same records as steps. (n,)."""
    raw_steps = []
    for s in made:
        asked = s["choice"][: int(s["choices"])].tolist()
        actor = -1 if s["actor"] == NOBODY else int(s["actor"])
        choices = tuple([RawChoice(*c) for c in asked])
        raw_steps.append(RawStep(actor, int(s["kind"]), int(s["release"]), int(s["time"]), choices))
    return tuple(raw_steps)
