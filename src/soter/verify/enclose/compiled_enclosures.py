"""The enclosures of one module as a compiled library: the grid engine, and functions over boxes.

Purpose: `ReachLibrary`: compile a generated enclosure unit together with `soter_reach*.c`, once for
each content, and reach both through cffi. `CompiledEnclosures`: evaluate `law`, `safe`, ... over
single boxes, for checks that look at few boxes.
Non-goals: generating the unit (`enclosure_code.py`); grids (`verify/grid/sets.py`), where C walks
over millions of cells.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.core.lower_statements import FunctionTable
from soter.core.steps import lower_predicate
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.model.tree_walk import PARTS_MAX
from soter.native.cache import cached, digest
from soter.native.compiler import STRICT, compile_with, find, vector_flags
from soter.native.shared_library import (
    CHECK_FAILED,
    OWN_SYMBOLS,
    declarations,
    include_flags,
    interface,
    objects,
    opened,
    texts,
)
from soter.native.source_files import files_below
from soter.verify.enclose.enclosure_code import (
    CONTROLS_MAX,
    EnclosureError,
    EnclosureUnit,
    generate_enclosures,
)
from soter.verify.problem.modes_of_other_modules import in_ac

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.core.core import Function, Predicate
    from soter.core.layout import Floats
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedExpr
    from soter.verify.problem.problem import Problem


HERE = Path(__file__).resolve().parents[1] / "engine"
ENGINE = tuple(file.name for file in files_below(HERE, "*.c"))
NUMBERS = ("law", "derivative", "next", "drives", *(f"law_{k}" for k in range(CONTROLS_MAX)))
TRUTHS = (
    *("safe", "constraint", "core", "ttf", "safer", "back", "enters"),
    *(f"{name}_{k}" for name in ("safe", "constraint", "safer", "back") for k in range(PARTS_MAX)),
)
FLAGS = (*STRICT, "-O3", "-fPIC", "-pthread")
UNIT_LEVEL = "-O3"
"""How the enclosures of a module are optimised; the bits are the same at every level. Tests prove
many small modules, each once, and would compile most of the time."""
LINKED = ("-shared", *OWN_SYMBOLS)
FORMS = "typedef struct soter_form soter_form; typedef unsigned char soter_truth;"
"""What Python sees of `soter_form.h`: only where its numbers are."""
UNIT = "enclosures.c"
MESSAGE = "the C of this module's enclosures does not compile"


def ffi() -> Any:  # noqa: ANN401 - cffi has no types
    """The declarations of the engine and of every function that a unit may have."""
    functions = [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in NUMBERS]
    functions += [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in TRUTHS]
    return interface(FORMS, declarations(HERE / "soter_reach.h"), "\n".join(functions))


def _inputs_of(source: str) -> int:
    match = re.search(r"^#define SOTER_INPUTS (\d+)$", source, re.MULTILINE)
    if match is None:
        raise ValueError("an enclosure unit defines SOTER_INPUTS")
    return int(match.group(1))


class ReachLibrary:
    """A loaded engine with one module's enclosures; holds no state."""

    def __init__(
        self,
        source: str,
        extra: tuple[str, ...] = (),
        reads: Mapping[str, frozenset[int]] = MappingProxyType({}),
    ) -> None:
        """`source`: the text of the enclosure unit; `extra`: more compiler flags (tests).

        `reads`: the inputs that each function of the unit reads, where they are known.
        """
        self.inputs, self.reads = _inputs_of(source), reads
        self.ffi = ffi()
        self.path = compiled(source, self.inputs, extra)
        """The library's file; its name is a hash of all that it was made of."""
        self.lib = opened(self.ffi, self.path)

    def symbol(self, name: str) -> Any:  # noqa: ANN401 - cdata
        """The address of `soter_NAME` of the unit, or NULL where the unit has no such function."""
        try:
            return self.ffi.cast("void *", self.ffi.addressof(self.lib, f"soter_{name}"))
        except (AttributeError, self.ffi.error):
            return self.ffi.NULL


def compiled(source: str, inputs: int, extra: tuple[str, ...] = ()) -> Path:
    """The shared library, from the cache or freshly built; SoterError X004, X006."""
    compiler = find()
    more = (f"-DSOTER_INPUTS={inputs}", *vector_flags(), *extra)
    flags, unit_flags = (*FLAGS, *more), (*FLAGS, UNIT_LEVEL, *more)
    engine = (*(HERE / name for name in ENGINE), CHECK_FAILED)
    headers = texts(*engine, *files_below(HERE, "*.h"))
    content = digest((source, compiler.identity, *flags, *unit_flags, *LINKED, *headers))
    name = f"reach-{content[:32]}.so"

    def make(work: Path) -> None:
        (work / UNIT).write_text(source, encoding="utf-8")
        command = (*compiler.command, *unit_flags, *include_flags(HERE / "soter_form.h"))
        with ThreadPoolExecutor(2) as both:
            made = both.submit(objects, engine, (*flags, *include_flags(HERE / "soter_form.h")))
            both.submit(compile_with, (*command, "-c", UNIT), work, MESSAGE).result()
        linked = (UNIT.replace(".c", ".o"), *map(str, made.result()))
        compile_with((*command, *LINKED, "-o", name, *linked, "-lm"), work, MESSAGE)

    return cached("reach", content, (name,), make) / name


TRUE = 2
"""A truth that is definitely true."""


def library_of(problem: Problem) -> tuple[ReachLibrary, tuple[str, ...]]:
    """The compiled enclosures, and the prelude functions that they use.

    `SoterError` R007 where something cannot be enclosed, or depends on a state without bounds.
    """
    hint, functions = hint_of(problem.system, problem.module)
    try:
        unit = generate_enclosures(
            problem.system,
            problem.core,
            problem.module,
            problem.quantities,
            core_hint=hint,
            hint_functions=functions,
            back=_back(problem),
        )
    except EnclosureError as error:
        span = getattr(error, "span", None) or problem.module.symbol.span
        note = "a proof must be able to enclose what the program computes"
        raise _refused(problem, str(error), span, note) from error
    _unread(problem, unit)
    return ReachLibrary(unit.source, reads=unit.reads), unit.prelude


def _refused(problem: Problem, why: str, span: Span, note: str) -> SoterError:
    diagnostics = Diagnostics()
    diagnostics.error("R007", f"module `{problem.name}`: {why}", span, notes=(note,))
    return SoterError(diagnostics.items)


def _unread(problem: Problem, unit: EnclosureUnit) -> None:
    """R007 where what moves the plants, or SC, reads a state whose axis is unbounded."""
    for group in problem.groups:
        for axis in (a for a in group.axes if a.unbounded):
            for name, who in (("law", "SC"), ("derivative", "what moves the plants")):
                if axis.state in unit.reads.get(name, ()):
                    why = f"{who} reads `{axis.name}`, whose axis is `open`"
                    note = "beyond the ends of such an axis nothing is known but that it is alike"
                    raise _refused(problem, why, group.span or problem.module.symbol.span, note)


def _back(problem: Problem) -> TypedExpr | None:
    """`safer` while those are in AC for whom it waits; None where it waits for nobody."""
    safer = problem.module.symbol.safer
    if safer is None or problem.modes is None or not problem.modes.waits:
        return None
    return in_ac(safer, problem.modes)


def hint_of(system: System, module: Module) -> tuple[Predicate | None, dict[str, Function]]:
    """`core e;` lowered, with the functions that it calls."""
    e = module.symbol.verify.core
    if e is None:
        return None, {}
    functions = FunctionTable(system)
    predicate = lower_predicate(functions, system, module.scope, e, e.span)
    return predicate, dict(functions.by_name)


class CompiledEnclosures:
    """Evaluates the unit over boxes; a box is an array (inputs, 2) of bounds in input order."""

    def __init__(self, library: ReachLibrary, problem: Problem, parameter: Sequence[int]) -> None:
        self.library = library
        self._n = library.inputs
        self._in = np.zeros((self._n, 4 + self._n))
        self._out = np.zeros((max(self._n, 64), 4 + self._n))
        self.results = len(self._out)
        """So many results a function may have at most."""
        self._param = np.array(list(parameter) or [0], dtype=np.int64)
        ranges = [
            (i.low, i.high)
            for part in (
                problem.states,
                problem.controls,
                problem.disturbances,
                problem.errors,
                problem.others,
            )
            for i in part
        ]
        self.whole: Floats = np.array(ranges, dtype=np.float64).reshape(-1, 2)
        """The box of all inputs over their whole ranges."""

    def within(self, ranges: Mapping[int, tuple[float, float]]) -> CompiledEnclosures:
        """The same with other ranges of some inputs in `whole`."""
        forms = copy(self)
        forms.whole = self.whole.copy()
        for i, r in ranges.items():
            forms.whole[i] = r
        return forms

    def affine(self, name: str, forms: Floats, count: int) -> Floats | None:
        """Forms of the results, (count, 4 + inputs): low, high, centre, remainder, coefficients.

        `forms`: of the inputs, in the same shape. None where a step fault is possible.
        """
        self._in[:] = 0.0
        self._in[: len(forms)] = forms
        return None if self._run(name) else np.array(self._out[:count])

    def truth(self, name: str, box: Floats) -> int:
        """Bit 0: may be false, bit 1: may be true; both where a step fault is possible.

        `box`: (inputs, 2).
        """
        return 3 if self._call(name, box) else int(self._out.view(np.uint8).flat[0])

    def _call(self, name: str, box: Floats) -> int:
        forms = self._in
        forms[:] = 0.0
        low, high = box[:, 0], box[:, 1]
        n = len(box)
        middle = low / 2 + high / 2
        radius = np.maximum(high - middle, middle - low)
        point = low == high
        forms[:n, 0], forms[:n, 1] = low, high
        forms[:n, 2] = np.where(point, low, middle)
        forms[range(n), range(4, 4 + n)] = np.where(point, 0.0, np.nextafter(radius, np.inf))
        return self._run(name)

    def _run(self, name: str) -> int:
        ffi = self.library.ffi
        function = getattr(self.library.lib, f"soter_{name}")
        return int(
            function(
                ffi.cast("void *", self._in.ctypes.data),
                ffi.cast("int64_t *", self._param.ctypes.data),
                ffi.cast("void *", self._out.ctypes.data),
            )
        )

    def numbers(self, name: str, box: Floats, count: int) -> Floats | None:
        """Bounds (count, 2) of the results; None where a step fault is possible."""
        if self._call(name, box):
            return None
        return np.array(self._out[:count, :2])

    def conjuncts(self, name: str) -> list[str]:
        """The functions whose conjunction is the predicate; none where it is no conjunction."""
        candidates = [f"{name}_{k}" for k in range(PARTS_MAX)]
        return [f for f in candidates if self.library.symbol(f) != self.library.ffi.NULL]

    def true(self, name: str, box: Floats) -> bool:
        """Whether a predicate is definitely true all over the box, (inputs, 2)."""
        fault = self._call(name, box)
        return not fault and int(self._out.view(np.uint8).flat[0]) == TRUE
