"""The checker: from loaded files to a checked `Program`.

Purpose: resolve every declaration once and on demand, then every body; all errors in one pass.
Non-goals: numbers of a particular system (`elaborate.py`), the paper's P1 (`wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_decl import DeclChecker
from soter.program.check_expr import ExprChecker
from soter.program.check_stmt import StmtChecker
from soter.program.context import Context
from soter.program.arith import StepFault
from soter.program.data import DataError, read_data
from soter.program.elaborate import children
from soter.program.evaluate import BudgetExceeded, Evaluator
from soter.program.scope import Entry, FileScope, Names
from soter.program.types import (
    BOOL,
    DURATION,
    ERROR,
    FLOAT,
    INT,
    ArrayType,
    ErrorType,
    IntType,
    ListType,
    RecordType,
    Type,
    leaf_count,
)
from soter.syntax import tree

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.loader import LoadedProgram
    from soter.program.types import Value

CONSTANT_BUDGET = 2_000_000
MAX_LEAVES = 100_000
BUILTIN_TYPES = {"bool": BOOL, "int": INT, "float": FLOAT, "duration": DURATION}


class Checker:
    """One checking run over one loaded program."""

    def __init__(self, loaded: LoadedProgram, diagnostics: Diagnostics) -> None:
        self.loaded = loaded
        self.diagnostics = diagnostics
        self.names = Names(diagnostics)
        self.expressions = ExprChecker(self)
        self.statements = StmtChecker(self, self.expressions)
        self.declarations = DeclChecker(self)
        self.published: dict[typed.NodeSymbol, set[typed.TopicSymbol]] = {}
        self.calls: dict[typed.FunSymbol | None, list[tuple[typed.FunSymbol, Span]]] = {}
        self.current_fun: typed.FunSymbol | None = None
        self._bodies: list[tuple[object, tree.Decl, FileScope]] = []
        self._pending: dict[typed.FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self._subtopics: dict[tuple[int, tuple[str, ...], str], typed.TopicSymbol] = {}
        self.stand_ins: dict[typed.TopicSymbol, tuple[tuple[str, ...], typed.TopicSymbol]] = {}

    # ------------------------------------------------------------ the whole

    def run(self) -> typed.Program:
        """Check everything; the program is only meaningful without errors."""
        for prelude in self.loaded.prelude:
            self.names.add_file(prelude)
        main = self.names.add_file(self.loaded.main)
        program = typed.Program(str(self.loaded.main.path), "")
        for scope in self.names.scopes:
            for entry in list(scope.entries.values()):
                self.resolve(entry, entry.decl.name.span, use=False)
        while self._bodies or self._pending:
            while self._pending:
                self.ensure_body(next(iter(self._pending)))
            if self._bodies:
                symbol, decl, scope = self._bodies.pop(0)
                self.declarations.body(symbol, decl, scope)
        self._report_recursion()
        for scope in self.names.scopes:
            for entry in scope.entries.values():
                self._register(program, entry)
        self._warn_unused(main)
        program.stand_ins = self.stand_ins
        program.sha256 = self.loaded.digest.hexdigest()
        return program

    def later(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """Check a body once every signature is known."""
        self._bodies.append((symbol, decl, scope))

    def _register(self, program: typed.Program, entry: Entry) -> None:
        symbol = entry.symbol
        tables: list[tuple[type, dict[str, object]]] = [
            (typed.ConstSymbol, program.consts),  # type: ignore[list-item]
            (typed.ParamSymbol, program.params),  # type: ignore[list-item]
            (typed.FunSymbol, program.funs),  # type: ignore[list-item]
            (typed.TopicSymbol, program.topics),  # type: ignore[list-item]
            (typed.NodeSymbol, program.nodes),  # type: ignore[list-item]
            (typed.ModuleSymbol, program.modules),  # type: ignore[list-item]
            (typed.PlantSymbol, program.plants),  # type: ignore[list-item]
            (typed.SystemSymbol, program.systems),  # type: ignore[list-item]
            (typed.TestSymbol, program.tests),  # type: ignore[list-item]
        ]
        for kind, table in tables:
            if isinstance(symbol, kind):
                table[entry.full_name] = symbol

    def _warn_unused(self, main: FileScope) -> None:
        """W001 for declarations of the main file that nothing mentions."""
        roots = {"system", "test"}
        has_roots = any(e.kind in roots for s in self.names.scopes for e in s.entries.values())
        if not has_roots:
            roots |= {"module", "plant", "node"}  # all of it is the implicit system
            if not any(e.kind in roots for e in main.entries.values()):
                return  # a library file of its own: everything is for others
        for entry in main.entries.values():
            name = entry.decl.name
            if entry.kind not in roots and not entry.used and not name.text.startswith("_"):
                self.diagnostics.warning(
                    "W001",
                    f"{entry.kind} `{name.text}` is never used",
                    name.span,
                    "declared here",
                    helps=(f"remove it, or call it `_{name.text}` to say that this is meant",),
                )
        for name, child in main.imports.items():
            if child is not None and name not in main.used_imports:
                span = next(i.name.span for i in main.loaded.file.imports if i.name.text == name)
                self.diagnostics.warning("W001", f"import `{name}` is never used", span)

    # ------------------------------------------------------------ resolution on demand

    def resolve(self, entry: Entry, span: Span, *, use: bool = True) -> object:
        """The symbol of a declaration; cycles are T012; None after an error."""
        if use:
            entry.used = True
        if entry.state == "done":
            return entry.symbol
        if entry.state == "resolving":
            self.diagnostics.error(
                "T012",
                f"{entry.kind} `{entry.decl.name.text}` is defined by itself",
                entry.decl.name.span,
                also=((span, "needed again here"),) if span != entry.decl.name.span else (),
            )
            return None
        entry.state = "resolving"
        entry.symbol = self.declarations.symbol(entry)
        entry.state = "done"
        return entry.symbol

    def module_handle(self, entry: Entry, span: Span) -> object:
        """The module symbol for `mode(M)`."""
        return self.resolve(entry, span)

    def subsystem_topic(
        self, system: typed.SystemSymbol, prefix: list[str], name: tree.Name
    ) -> typed.TopicSymbol | None:
        """A stand-in symbol for a topic of a sub-system instance, one for each path."""
        for topic in self.declarations.topics_of(system):
            if topic.name.rsplit(".", 1)[-1] == name.text:
                key = (id(system), tuple(prefix), name.text)
                known = self._subtopics.get(key)
                if known is None:
                    known = typed.TopicSymbol(
                        ".".join((*prefix, topic.name)), name.span, topic.type,
                        topic.input, {}, None, None,
                    )
                    self._subtopics[key] = known
                    self.stand_ins[known] = (tuple(prefix), topic)
                return known
        return None

    # ------------------------------------------------------------ functions

    def defer_body(self, fun: typed.FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Remember a function body; prelude bodies are only checked when called."""
        if scope.loaded.prelude:
            self.declarations.lazy_bodies[fun] = (decl, scope)
        else:
            self._pending[fun] = (decl, scope)

    def note_call(self, fun: typed.FunSymbol, span: Span) -> None:
        """Record the call edge and make sure the callee's body gets checked."""
        self.calls.setdefault(self.current_fun, []).append((fun, span))
        lazy = self.declarations.lazy_bodies.pop(fun, None)
        if lazy is not None:
            self._pending[fun] = lazy

    def ensure_body(self, fun: typed.FunSymbol) -> None:
        """Check a function's body now if that was not done yet."""
        pending = self._pending.pop(fun, None)
        if pending is not None:
            outer, self.current_fun = self.current_fun, fun
            self.declarations.fun_body(fun, *pending)
            self.current_fun = outer

    def _callees(self, fun: typed.FunSymbol) -> list[tuple[typed.FunSymbol, Span]]:
        return self.calls.get(fun, [])

    def find_recursion(self, root: typed.FunSymbol) -> list[tuple[typed.FunSymbol, Span]] | None:
        """A cycle of calls reachable from `root`, as (callee, call site) edges, or None."""
        done: set[typed.FunSymbol] = set()
        path: list[typed.FunSymbol] = [root]
        edges: list[tuple[typed.FunSymbol, Span]] = []
        iterators = [iter(self._callees(root))]
        while iterators:
            step = next(iterators[-1], None)
            if step is None:
                iterators.pop()
                done.add(path.pop())
                if edges:
                    edges.pop()
                continue
            callee, span = step
            if callee in path:
                return [*edges[path.index(callee) :], (callee, span)]
            if callee not in done:
                path.append(callee)
                edges.append((callee, span))
                iterators.append(iter(self._callees(callee)))
        return None

    def _report_recursion(self) -> None:
        reported: set[typed.FunSymbol] = set()
        for fun in list(self.calls):
            if fun is None or fun in reported:
                continue
            cycle = self.find_recursion(fun)
            if cycle is None or any(f in reported for f, _ in cycle):
                continue
            reported.update(f for f, _ in cycle)
            self.report_cycle(cycle)

    def report_cycle(self, cycle: list[tuple[typed.FunSymbol, Span]]) -> None:
        """T006 for one cycle of calls."""
        names = " -> ".join(f.name for f, _ in (cycle[-1], *cycle[:-1], cycle[-1]))
        self.diagnostics.error(
            "T006",
            f"recursion: {names}",
            cycle[-1][1],
            "this call closes the cycle",
            notes=("without recursion the time and stack of every step have a bound",),
            helps=("write a `for` loop with a constant bound",),
        )

    # ------------------------------------------------------------ constants

    def constant(
        self,
        expr: tree.Expr,
        scope: FileScope,
        expected: Type,
        what: str,
        context: Context | None = None,
    ) -> Value | None:
        """The value of a constant expression, or None after a report (T008)."""
        inner = Context(scope, what, constant=True)
        if context is not None:
            local = next(
                (
                    n
                    for n in _names_in(expr)
                    if context.find_local(n.text) is not None
                ),
                None,
            )
            if local is not None:
                unbounded = what == "a loop bound"
                self.diagnostics.error(
                    "T007" if unbounded else "T008",
                    f"`{local.text}` is not known when the program is compiled, but {what} must be",
                    local.span,
                    "known only at run time",
                    notes=("every step must end within a bound known beforehand",)
                    if unbounded
                    else (),
                    helps=("loop to a constant maximum and skip with `if` inside",)
                    if unbounded
                    else (),
                )
                return None
        checked = self.expressions.check(expr, inner, expected)
        return self.constant_value(checked)

    def constant_value(
        self, checked: typed.Expr, params: dict[typed.ParamSymbol, Value] | None = None
    ) -> Value | None:
        """Evaluate a closed typed expression; T008 when it faults, None after an error."""
        if isinstance(checked.type, ErrorType):
            return None
        if isinstance(checked, typed.Literal):
            return checked.value
        called = _called(checked)
        for fun in called:
            self._ensure_reachable(fun)
            cycle = self.find_recursion(fun)
            if cycle is not None:
                self.report_cycle(cycle)
                return None
        if self.diagnostics.has_errors and called:
            return None  # a broken function is not worth running
        try:
            return Evaluator(params or {}, None, CONSTANT_BUDGET).value(checked)
        except StepFault as fault:
            self.diagnostics.error(
                "T008", f"this constant has no value: {fault.kind.name.lower()}", checked.span
            )
        except BudgetExceeded:
            self.diagnostics.error(
                "T008", "computing this constant takes too long", checked.span
            )
        return None

    def _ensure_reachable(self, fun: typed.FunSymbol) -> None:
        seen: set[typed.FunSymbol] = set()
        todo = [fun]
        while todo:
            f = todo.pop()
            if f in seen:
                continue
            seen.add(f)
            self.ensure_body(f)
            todo.extend(c for c, _ in self._callees(f))

    def data(self, decl: tree.ConstDecl, t: Type, scope: FileScope) -> Value | None:
        """The value of `data "file"`; D003/D004 when it cannot be had."""
        assert decl.data is not None
        path = scope.loaded.path.parent / decl.data
        try:
            value, raw = read_data(path, t)
        except DataError as error:
            missing = not path.is_file()
            self.diagnostics.error(
                "D003" if missing else "D004",
                f"cannot find data file `{decl.data}`"
                if missing
                else f"`{decl.data}` is not a `{t}`: {error}",
                decl.data_span,
            )
            return None
        except ValueError:
            self.diagnostics.error("D003", f"bad path `{decl.data}`", decl.data_span)
            return None
        self.loaded.digest.update(f"data {decl.data}\0{len(raw)}\0".encode())
        self.loaded.digest.update(raw)
        return value

    # ------------------------------------------------------------ types

    def type_of(self, expr: tree.TypeExpr, scope: FileScope) -> Type:
        """The type a type expression means; ERROR after a report."""
        t = self._type_of(expr, scope)
        if not isinstance(t, ErrorType) and leaf_count(t) > MAX_LEAVES:
            self.diagnostics.error(
                "T011",
                f"`{t}` has {leaf_count(t)} scalars, at most {MAX_LEAVES} are allowed",
                expr.span,
            )
            return ERROR
        return t

    def _type_of(self, expr: tree.TypeExpr, scope: FileScope) -> Type:
        if isinstance(expr, tree.BuiltinType):
            return BUILTIN_TYPES[expr.name]
        if isinstance(expr, tree.RangedIntType):
            low = self.constant(expr.interval.low, scope, INT, "the bound of a type")
            high = self.constant(expr.interval.high, scope, INT, "the bound of a type")
            if low is None or high is None:
                return ERROR
            if low > high:
                self.diagnostics.error(
                    "V001", f"[{low}, {high}] is empty", expr.interval.span
                )
                return ERROR
            return IntType(low, high)
        if isinstance(expr, tree.NamedType):
            return self._named_type(expr, scope)
        if isinstance(expr, tree.RecordTypeExpr):
            return self._record_type(expr, scope)
        if isinstance(expr, (tree.ArrayTypeExpr, tree.ListTypeExpr)):
            return self._array_type(expr, scope)
        self.diagnostics.error("T018", "an enum needs a name: `type Name = enum { ... };`", expr.span)
        return ERROR

    def _named_type(self, expr: tree.NamedType, scope: FileScope) -> Type:
        if expr.ref.qualifier is None and expr.ref.name.text == "Mode":
            own = scope.entries.get("Mode")
            if own is None:
                from soter.program.types import MODE  # noqa: PLC0415 - one rare name

                return MODE
        entry = self.names.find_ref(scope, expr.ref)
        if entry is None:
            return ERROR
        if entry.kind != "type":
            self.diagnostics.error(
                "N003", f"`{expr.ref.text}` is a {entry.kind}, not a type", expr.span
            )
            return ERROR
        t = self.resolve(entry, expr.span)
        return t if isinstance(t, Type) else ERROR

    def _record_type(self, expr: tree.RecordTypeExpr, scope: FileScope) -> Type:
        fields: list[tuple[str, Type]] = []
        failed = False
        for name, field_type in expr.fields:
            t = self.type_of(field_type, scope)
            if any(n == name.text for n, _ in fields):
                self.diagnostics.error(
                    "N002", f"field `{name.text}` is declared twice", name.span
                )
                failed = True
            if t is DURATION:
                self._no_duration(field_type)
                failed = True
            failed = failed or isinstance(t, ErrorType)
            fields.append((name.text, t))
        return ERROR if failed else RecordType(tuple(fields))

    def _array_type(
        self, expr: tree.ArrayTypeExpr | tree.ListTypeExpr, scope: FileScope
    ) -> Type:
        element = self.type_of(expr.element, scope)
        is_array = isinstance(expr, tree.ArrayTypeExpr)
        size_expr = expr.size if isinstance(expr, tree.ArrayTypeExpr) else expr.capacity
        size = self.constant(size_expr, scope, INT, "the size of an array")
        if size is None or isinstance(element, ErrorType):
            return ERROR
        if element is DURATION:
            self._no_duration(expr.element)
            return ERROR
        if not 1 <= size <= MAX_LEAVES:
            self.diagnostics.error(
                "T011", f"a size of {size} is not possible: 1 to {MAX_LEAVES} are", size_expr.span
            )
            return ERROR
        return ArrayType(element, size) if is_array else ListType(element, size)

    def _no_duration(self, expr: tree.TypeExpr) -> None:
        self.diagnostics.error(
            "T014",
            "`duration` is for constants and parameters only",
            expr.span,
            helps=("keep times in values as `float` seconds",),
        )


def _names_in(expr: tree.Expr) -> list[tree.Name]:
    """All bare names of an expression (constants are small: a plain walk)."""
    found: list[tree.Name] = []
    todo: list[object] = [expr]
    while todo:
        e = todo.pop()
        if isinstance(e, tree.NameExpr):
            found.append(e.name)
        elif isinstance(e, tree.Expr):
            for slot in ("target", "index", "operand", "left", "right", "condition", "then",
                         "otherwise", "arguments", "elements"):
                child = getattr(e, slot, None)
                if isinstance(child, tuple):
                    todo.extend(child)
                elif child is not None:
                    todo.append(child)
    return found


def _called(root: typed.Expr) -> list[typed.FunSymbol]:
    """Functions an expression calls itself."""
    found: dict[typed.FunSymbol, None] = {}
    todo: list[object] = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, typed.Call):
            found.setdefault(node.fun)
        todo.extend(children(node))
    return list(found)


def check(loaded: LoadedProgram, diagnostics: Diagnostics) -> typed.Program:
    """Check a loaded program; errors go into `diagnostics`."""
    return Checker(loaded, diagnostics).run()


__all__ = ["Checker", "Entry", "check"]
