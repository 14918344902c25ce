"""The enclosures of one module, generated as C, compiled with the engine, called over boxes.

Purpose: `generate_enclosures` writes the functions `law`, `derivative` or `next`, `safe`,
`constraint`, `core`, `ttf`, `safer` and `drives` of one module over the forms of
`verify/engine/soter_form.h` (docs/verification.md, section 2). `ReachLibrary` holds such a unit,
compiled with `soter_reach*.c` once for each content, and calls both through cffi.
`CompiledEnclosures` evaluates `law`, `safe`, ... over single boxes, for checks of few boxes.
Non-goals: the meaning of a step (`enclosed_steps.py`); grids (`verify/grid/sets.py`), where C walks
over millions of cells.

A value that is no input of a function ranges over its declared set, without a symbol.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.codegen import c_tree as c
from soter.codegen.c_printer import print_file
from soter.core.lower_statements import FunctionTable
from soter.core.steps import lower_predicate
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.model.tree_walk import PARTS_MAX, conjuncts
from soter.native.c_interface import declarations, interface, open_library
from soter.native.cache import cached_folder, digest, files_below
from soter.native.compiler import STRICT, compile_with, find_compiler, vector_flags
from soter.native.shared_library import CHECK_FAILED, OWN_SYMBOLS, c_texts, include_flags, objects
from soter.verify.enclose.enclosed_operations import EnclosureOperations
from soter.verify.enclose.enclosed_steps import EnclosedFunction
from soter.verify.enclose.enclosure_emitter import (
    Emitter,
    EnclosureError,
    function_body,
    names_in,
    result_statement,
)
from soter.verify.problem.supported_constructs import ttf_of_states
from soter.verify.problem.verification_system import expression_with_others_in_ac

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.core import core as core_ir
    from soter.core.layout import Floats
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedExpr
    from soter.verify.problem.problem import Problem, Quantities


PARAMETERS = (
    ("const soter_form ", "in[]"),
    ("const int64_t ", "param[]"),
    ("soter_form ", "out[]"),
)
CONTROLS_MAX = 8
"""If SC has no more controls than this, each has a function that computes it alone."""
PREDICATE_PARAMETERS = (*PARAMETERS[:2], ("soter_truth ", "out[]"))


@dataclass(frozen=True)
class EnclosureUnit:
    """The C text of one module's enclosures, and what its functions depend on."""

    source: str
    prelude: tuple[str, ...]
    """The prelude functions whose tested error bounds were used
    (`language/prelude/function_error_bounds.py`)."""
    functions: tuple[str, ...]
    """The names of the emitted functions: `soter_law`, `soter_derivative`, ..."""
    reads: Mapping[str, frozenset[int]]
    """The float inputs that each function reads, by its name without `soter_`."""
    boundless: frozenset[str]
    """The functions that read a number without bounds, such as a state that is no input."""
    of_turns: frozenset[str]
    """The functions that depend on how many full turns a state has made."""


def generate_enclosures(
    system: System,
    core: core_ir.CoreSystem,
    module: Module,
    quantities: Quantities,
    back: TypedExpr | None = None,
    *,
    apart: bool = False,
) -> EnclosureUnit:
    """Generates the enclosures of a module in its verification system.

    `back` is the predicate that P2b uses instead of `safer`, if any. With `apart`, each state also
    has a function for its derivative alone, `derivative_K`. Raises `EnclosureError` with the reason
    in words if something cannot be enclosed.
    """
    unit = _UnitWriter(system, core, module, quantities)
    unit.emit_functions(back)
    if apart:
        unit.emit_derivatives()
    prelude, boundless = tuple(sorted(unit.prelude)), frozenset(unit.boundless)
    names, of_turns = tuple(unit.names), frozenset(unit.of_turns)
    return EnclosureUnit(unit.text_of_unit(), prelude, names, unit.reads, boundless, of_turns)


class _UnitWriter:
    """Writes the C text of one module's enclosures, function by function."""

    def __init__(
        self, system: System, core: core_ir.CoreSystem, module: Module, quantities: Quantities
    ) -> None:
        self.system = system
        self.core = core
        self.module = module
        self.quantities = quantities
        self.statics: dict[tuple[str, str], c.VariableDef] = {}
        self.prelude: set[str] = set()
        self.definitions: list[c.FunctionDef] = []
        self.names: list[str] = []
        self.reads: dict[str, frozenset[int]] = {}
        self.boundless: set[str] = set()
        self.of_turns: set[str] = set()

    def emit_functions(self, back: TypedExpr | None) -> None:
        """Emits all functions that the module needs."""
        hint, more = self._core_hint()
        symbol = self.module.symbol
        if not symbol.synthesized:
            self._emit_law()
        if any(p.integrate for p in self.core.plants.values()):
            flow = EnclosedFunction.is_flow(self.core)
            text = "derivative of every state" if flow else "every state one period later"
            name = "derivative" if flow else "next"
            self._emit_number_function(
                name, text, lambda e: e.derivatives() if flow else e.next_states()
            )
        self._emit_number_function(
            "drives", "leaves of the topics that plants drive", lambda e: e.driven_leaves()
        )
        self._emit_predicate("safe", symbol.safe, estimated=False)
        self._emit_constraint(symbol.safe)
        if hint is not None:
            self._emit_truth_function(
                "core", lambda e: e.truth_of_predicate(hint, more, estimated=False)
            )
        ttf = ttf_of_states(symbol.ttf)
        for name, expr in (("ttf", ttf), ("safer", symbol.safer), ("back", back)):
            if expr is not None:
                self._emit_predicate(name, expr, estimated=True)
        if symbol.verify.enters is not None:
            with suppress(EnclosureError):  # claims that need it are then not shown
                self._emit_expression("enters", symbol.verify.enters, estimated=True)

    def _core_hint(self) -> tuple[core_ir.Predicate | None, dict[str, core_ir.Function]]:
        """The `core` hint in Core and the functions that it calls; (None, {}) without a hint."""
        e = self.module.symbol.verify.core
        if e is None:
            return None, {}
        functions = FunctionTable(self.system)
        predicate = lower_predicate(functions, self.system, self.module.scope, e, e.span)
        return predicate, dict(functions.by_name)

    def emit_derivatives(self) -> None:
        """Emits a separate function for the derivative of each state."""
        for k, leaf in enumerate(self.quantities.states):
            enclosed = self._new_function()
            rate = result_statement(0, enclosed.derivatives()[k])
            doc = f"derivative of {leaf.name} alone"
            self._add_function(f"derivative_{k}", doc, PARAMETERS, enclosed.emitter, [rate])

    def _emit_constraint(self, safe: TypedExpr) -> None:
        """Emits the predicate C and its conditions: of `safe`, then of plants' published values."""
        parts = conjuncts(safe)
        self._emit_truth_function("constraint", lambda e: e.truth_of_constraint(safe))
        probe = self._new_function()
        probe.compute_driven_topics()
        leaves = len(probe.set_conditions())
        numbers = [*range(leaves)] if len(parts) + leaves <= PARTS_MAX else [None]
        if len(parts) == PARTS_MAX:
            return  # C is then checked without its conditions
        for k, part in enumerate(parts):
            self._emit_expression(f"constraint_{k}", part, estimated=False)
        for k, number in enumerate(numbers, len(parts)):
            self._emit_truth_function(
                f"constraint_{k}",
                lambda e, n=number: e.truth_of_publishing(n),  # type: ignore[misc]
            )

    def _emit_law(self) -> None:
        """Emits the function `law` for all controls of SC, and `law_K` for each control alone.

        `law_K` writes control K into out[K] and reports no faults elsewhere in SC; `law` does.
        """
        enclosed = self._new_function()
        results = [result_statement(i, e) for i, e in enumerate(enclosed.commands_of_sc())]
        emitter = enclosed.emitter
        self._add_function("law", "SC's published controls", PARAMETERS, emitter, results)
        if 1 < len(results) <= CONTROLS_MAX:
            for k, result in enumerate(results):
                doc = f"{self.quantities.controls[k].name} alone; faults elsewhere are not seen"
                self._add_function(f"law_{k}", doc, PARAMETERS, emitter, [result], faults=False)

    def _emit_predicate(self, name: str, predicate: TypedExpr, *, estimated: bool) -> None:
        """Emits a predicate and, if it is a conjunction, each of its conditions."""
        self._emit_expression(name, predicate, estimated=estimated)
        parts = conjuncts(predicate)
        for k, part in enumerate(parts if len(parts) > 1 else []):
            self._emit_expression(f"{name}_{k}", part, estimated=estimated)

    def _emit_expression(self, name: str, expr: TypedExpr, *, estimated: bool) -> None:
        self._emit_truth_function(name, lambda e: e.truth_of_expression(expr, estimated=estimated))

    def _new_function(self) -> EnclosedFunction:
        emitter = Emitter(self.statics)
        return EnclosedFunction(
            self.system, self.core, self.module, self.quantities, emitter, self.prelude
        )

    def _emit_number_function(
        self, name: str, doc: str, make: Callable[[EnclosedFunction], list[c.CExpr]]
    ) -> None:
        enclosed = self._new_function()
        results = [result_statement(i, e) for i, e in enumerate(make(enclosed))]
        self._add_function(name, doc, PARAMETERS, enclosed.emitter, results)

    def _emit_truth_function(self, name: str, make: Callable[[EnclosedFunction], c.CExpr]) -> None:
        enclosed = self._new_function()
        result = c.Assign(c.IndexExpr(c.Name("out"), c.Number("0")), make(enclosed))
        doc = f"`{name}` of {self.module.name}: false, true or either"
        self._add_function(name, doc, PREDICATE_PARAMETERS, enclosed.emitter, [result])

    def _add_function(
        self,
        name: str,
        doc: str,
        parameters: tuple[tuple[str, str], ...],
        emitter: Emitter,
        results: list[c.CStmt],
        *,
        faults: bool = True,
    ) -> None:
        body = function_body(emitter.block, emitter.reads, results, faults=faults)
        mentioned = set(names_in(body))
        self.reads[name] = frozenset(k for k, x in emitter.reads.items() if x.text in mentioned)
        if EnclosureOperations(emitter).any_number in mentioned:
            self.boundless.add(name)
        if emitter.reads_turns:
            self.of_turns.add(name)
        full = f"soter_{name}"
        self.names.append(full)
        made = c.FunctionDef("unsigned", full, parameters, body, doc, static=False)
        self.definitions.append(made)

    def text_of_unit(self) -> str:
        """The text of the translation unit."""
        q = self.quantities
        counts = {
            "INPUTS": len(q.inputs),
            "STATES": len(q.states),
            "CONTROLS": len(q.controls),
            "DISTURBANCES": len(q.disturbances),
            "ERRORS": len(q.errors),
            "OTHERS": len(q.others),
            "PARAMS": len(q.parameters),
        }
        legend = [f"in[{i}] {x.name}" for i, x in enumerate(q.inputs)]
        legend += [f"param[{i}] {x.name}" for i, x in enumerate(q.parameters)]
        # no name of a system: what is equal in several is compiled, and computed with, once
        items: list[c.CTop] = [c.FileComment(("Enclosures of a module.", *legend))]
        items += [c.Define(f"SOTER_{n}", str(k)) for n, k in counts.items()]
        items.append(c.Include("soter_form.h"))
        prototypes = [replace(f, body=None, doc="") for f in self.definitions]
        used = {n for f in self.definitions for n in names_in(f.body)}
        statics = [s for s in self.statics.values() if s.name in used]
        return print_file(c.CFile((*items, *prototypes, *statics, *self.definitions)))


HERE = Path(__file__).resolve().parents[1] / "engine"
ENGINE = tuple(file.name for file in files_below(HERE, "*.c"))
NUMBERS = ("law", "derivative", "next", "drives", *(f"law_{k}" for k in range(CONTROLS_MAX)))
TRUTHS = (
    *("safe", "constraint", "core", "ttf", "safer", "back", "enters"),
    *(f"{name}_{k}" for name in ("safe", "constraint", "safer", "back") for k in range(PARTS_MAX)),
)
FLAGS = (*STRICT, "-O3", "-fPIC", "-pthread")
UNIT_LEVEL = "-O3"
"""The compiler's optimisation level for enclosures. Results have the same bits at every level, so
tests, which prove many small modules once each, may lower it to compile faster."""
LINKED = ("-shared", *OWN_SYMBOLS)
FORMS = "typedef struct soter_form soter_form; typedef unsigned char soter_truth;"
"""The declarations of `soter_form.h` that Python needs: forms are opaque to it."""
UNIT = "enclosures.c"
MESSAGE = "the C of this module's enclosures does not compile"


def engine_ffi() -> Any:  # noqa: ANN401 - cffi has no types
    """The C declarations of the engine and of every function that a unit may have, for cffi."""
    functions = [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in NUMBERS]
    functions += [f"unsigned soter_{n}(const void *, const int64_t *, void *);" for n in TRUTHS]
    return interface(FORMS, declarations(HERE / "soter_reach.h"), "\n".join(functions))


def _input_count(source: str) -> int:
    match = re.search(r"^#define SOTER_INPUTS (\d+)$", source, re.MULTILINE)
    if match is None:
        raise ValueError("an enclosure unit defines SOTER_INPUTS")
    return int(match.group(1))


class ReachLibrary:
    """The loaded engine with one module's enclosures; it has no state."""

    def __init__(
        self,
        source: str,
        extra: tuple[str, ...] = (),
        reads: Mapping[str, frozenset[int]] = MappingProxyType({}),
    ) -> None:
        """Compiles and loads `source`, an enclosure unit; `extra` has more compiler flags.

        `reads` has the inputs that each function of the unit reads, if they are known.
        """
        self.inputs, self.reads = _input_count(source), reads
        self.ffi = engine_ffi()
        self.path = compiled_library(source, self.inputs, extra)
        """The library's file, whose name is a hash of everything it was built from."""
        self.lib = open_library(self.ffi, self.path)

    def symbol(self, name: str) -> Any:  # noqa: ANN401 - cdata
        """The address of the function `soter_NAME` in the unit; NULL if the unit has none."""
        try:
            return self.ffi.cast("void *", self.ffi.addressof(self.lib, f"soter_{name}"))
        except (AttributeError, self.ffi.error):
            return self.ffi.NULL


def compiled_library(source: str, inputs: int, extra: tuple[str, ...] = ()) -> Path:
    """The path of the shared library, which is built if not cached; may raise X004 or X006."""
    compiler = find_compiler()
    more = (f"-DSOTER_INPUTS={inputs}", *vector_flags(), *extra)
    flags, unit_flags = (*FLAGS, *more), (*FLAGS, UNIT_LEVEL, *more)
    engine = (*(HERE / name for name in ENGINE), CHECK_FAILED)
    headers = c_texts(*engine, *files_below(HERE, "*.h"))
    content = digest((source, compiler.identity, *flags, *unit_flags, *LINKED, *headers))
    name = f"reach-{content[:32]}.so"

    def build_library(work: Path) -> None:
        (work / UNIT).write_text(source, encoding="utf-8")
        command = (*compiler.command, *unit_flags, *include_flags(HERE / "soter_form.h"))
        with ThreadPoolExecutor(2) as both:
            made = both.submit(objects, engine, (*flags, *include_flags(HERE / "soter_form.h")))
            both.submit(compile_with, (*command, "-c", UNIT), work, MESSAGE).result()
        linked = (UNIT.replace(".c", ".o"), *map(str, made.result()))
        compile_with((*command, *LINKED, "-o", name, *linked, "-lm"), work, MESSAGE)

    return cached_folder("reach", content, (name,), build_library) / name


TRUE = 2
"""The truth value, a bit mask, of what is certainly true."""


def library_of(problem: Problem) -> tuple[ReachLibrary, tuple[str, ...]]:
    """The compiled enclosures of a problem, and the prelude functions that they use.

    `SoterError` R007 where something cannot be enclosed, or depends on a state without bounds.
    """
    parts = problem.system, problem.core, problem.module, problem.quantities
    try:
        unit = generate_enclosures(*parts, _safer_in_ac(problem))
    except EnclosureError as error:
        span = getattr(error, "span", None) or problem.module.symbol.span
        note = "a proof must be able to enclose what the program computes"
        raise _refusal(problem, str(error), span, note) from error
    _refuse_unbounded_reads(problem, unit)
    return ReachLibrary(unit.source, reads=unit.reads), unit.prelude


def _refusal(problem: Problem, why: str, span: Span, note: str) -> SoterError:
    diagnostics = Diagnostics()
    diagnostics.error("R007", f"module `{problem.name}`: {why}", span, notes=(note,))
    return SoterError(diagnostics.items)


def _refuse_unbounded_reads(problem: Problem, unit: EnclosureUnit) -> None:
    """Raises R007 if SC or a derivative of the plants reads a state whose axis is unbounded."""
    for group in problem.groups:
        for axis in (a for a in group.axes if a.unbounded):
            for name, who in (("law", "SC"), ("derivative", "what moves the plants")):
                if axis.state in unit.reads.get(name, ()):
                    why = f"{who} reads `{axis.name}`, whose axis is `open`"
                    note = "beyond the ends of such an axis nothing is known but that it is alike"
                    raise _refusal(problem, why, group.span or problem.module.symbol.span, note)


def _safer_in_ac(problem: Problem) -> TypedExpr | None:
    """`safer` with every mode that it waits for taken as AC; None if it waits for no mode."""
    safer = problem.module.symbol.safer
    if safer is None or problem.modes is None or not problem.modes.waits:
        return None
    return expression_with_others_in_ac(safer, problem.modes)


FORM = 4
"""The index of the first coefficient of a form, after low, high, centre and remainder."""


def affine_inputs(box: Floats, count: int) -> Floats:
    """Forms (count, 4 + count) of the inputs in a box (n, 2), a symbol each; rows beyond are 0."""
    low, high = box[:, 0], box[:, 1]
    n, point, middle = len(box), low == high, low / 2 + high / 2
    radius = np.nextafter(np.maximum(high - middle, middle - low), np.inf)
    forms = np.zeros((count, FORM + count))
    forms[:n, 0], forms[:n, 1] = low, high
    forms[:n, 2] = np.where(point, low, middle)
    forms[range(n), range(FORM, FORM + n)] = np.where(point, 0.0, radius)
    return forms


class CompiledEnclosures:
    """Evaluates a unit over boxes; a box (inputs, 2) has the bounds of all inputs in order."""

    def __init__(self, library: ReachLibrary, problem: Problem, parameter: Sequence[int]) -> None:
        self.library = library
        self._n = library.inputs
        self._in = np.zeros((self._n, FORM + self._n))
        self._out = np.zeros((max(self._n, 64), FORM + self._n))
        self.results = len(self._out)
        """The largest number of results that a function may have."""
        self._param = np.array(list(parameter) or [0], dtype=np.int64)
        inputs = (*problem.states, *problem.controls, *problem.disturbances, *problem.errors)
        ranges = [(i.low, i.high) for i in (*inputs, *problem.others)]
        self.whole: Floats = np.array(ranges, dtype=np.float64).reshape(-1, 2)
        """The box of all inputs, each over its whole range."""

    def affine_results(self, name: str, forms: Floats, count: int) -> Floats | None:
        """Forms of the results, (count, 4 + inputs): low, high, centre, remainder, coefficients.

        `forms`: the forms of the inputs, of the same shape. None: a step fault is possible.
        """
        self._in[:] = 0.0
        self._in[: len(forms)] = forms
        return None if self._fault_of_call(name) else np.array(self._out[:count])

    def truth(self, name: str, box: Floats) -> int:
        """The truth of a predicate over a box (inputs, 2): bit 0: may be false, bit 1: may be true.

        Both bits are set where a step fault is possible.
        """
        return 3 if self._fault_over_box(name, box) else int(self._out.view(np.uint8).flat[0])

    def _fault_over_box(self, name: str, box: Floats) -> int:
        self._in[:] = affine_inputs(box, self._n)
        return self._fault_of_call(name)

    def _fault_of_call(self, name: str) -> int:
        ffi = self.library.ffi
        function = getattr(self.library.lib, f"soter_{name}")
        return int(
            function(
                ffi.cast("void *", self._in.ctypes.data),
                ffi.cast("int64_t *", self._param.ctypes.data),
                ffi.cast("void *", self._out.ctypes.data),
            )
        )

    def result_bounds(self, name: str, box: Floats, count: int) -> Floats | None:
        """The bounds (count, 2) of a function's results over a box; None if it may fault there."""
        if self._fault_over_box(name, box):
            return None
        return np.array(self._out[:count, :2])

    def conjunct_names(self, name: str) -> list[str]:
        """The names of the functions for a predicate's conjuncts; none if it is no conjunction."""
        candidates = [f"{name}_{k}" for k in range(PARTS_MAX)]
        return [f for f in candidates if self.library.symbol(f) != self.library.ffi.NULL]

    def is_surely_true(self, name: str, box: Floats) -> bool:
        """Whether a predicate is certainly true all over a box (inputs, 2)."""
        fault = self._fault_over_box(name, box)
        return not fault and int(self._out.view(np.uint8).flat[0]) == TRUE
