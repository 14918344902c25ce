"""Who calls whom: no recursion, and what a function needs when it runs.

Purpose: the graph of calls, grown while bodies are checked; cycles in it are T006.
Non-goals: checking bodies (`declarations.py`), costs of steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.check.scope import FileScope
    from soter.language.model.typed import FunSymbol, ParamSymbol
    from soter.language.syntax import tree

    CheckBody = Callable[[FunSymbol, tree.FunDecl, FileScope], bool]
    # checks the body of a function; whether it is without errors

MAX_CALLS_SHOWN = 4


class CallGraph:
    """Functions, the calls in them, and their bodies, which are checked once and on demand."""

    def __init__(self, diagnostics: Diagnostics, check_body: CheckBody) -> None:
        self.diagnostics = diagnostics
        self._check_body = check_body
        self.current: FunSymbol | None = None
        """The function whose body is being checked."""
        self._calls: dict[FunSymbol, list[tuple[FunSymbol, Span]]] = {}
        self._params: dict[FunSymbol, tuple[ParamSymbol, Span]] = {}
        self._unchecked: dict[FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self._lazy: dict[FunSymbol, tuple[tree.FunDecl, FileScope]] = {}
        self._broken: set[FunSymbol] = set()
        self._walked: set[FunSymbol] = set()
        self._recursive: set[FunSymbol] = set()

    # ------------------------------------------------------------ bodies

    def add(self, fun: FunSymbol, decl: tree.FunDecl, scope: FileScope) -> None:
        """Remember a body for later; bodies of the prelude are only checked when called."""
        (self._lazy if scope.loaded.prelude else self._unchecked)[fun] = (decl, scope)

    def mark_invalid(self, fun: FunSymbol) -> None:
        """A function whose declaration has an error: constants cannot be made with it."""
        self._broken.add(fun)

    def call(self, fun: FunSymbol, span: Span) -> None:
        """A call was met; the callee's body is needed too."""
        if self.current is not None:
            self._calls.setdefault(self.current, []).append((fun, span))
        lazy = self._lazy.pop(fun, None)
        if lazy is not None:
            self._unchecked[fun] = lazy

    def param(self, param: ParamSymbol, span: Span) -> None:
        """A parameter of the program was read."""
        if self.current is not None:
            self._params.setdefault(self.current, (param, span))

    def check_body(self, fun: FunSymbol) -> None:
        """Check a function's body now if that was not done yet."""
        waiting = self._unchecked.pop(fun, None)
        if waiting is None:
            return
        outer, self.current = self.current, fun
        if not self._check_body(fun, *waiting):
            self._broken.add(fun)
        self.current = outer

    def check_bodies(self) -> bool:
        """Check every body still waiting; whether there was one."""
        some = bool(self._unchecked)
        while self._unchecked:
            self.check_body(next(iter(self._unchecked)))
        return some

    # ------------------------------------------------------------ questions

    def _below(self, fun: FunSymbol) -> Iterator[FunSymbol]:
        """The function and everything it calls, bodies checked."""
        seen = {fun}
        todo = [fun]
        while todo:
            f = todo.pop()
            self.check_body(f)
            yield f
            for callee, _ in self._calls.get(f, ()):
                if callee not in seen:
                    seen.add(callee)
                    todo.append(callee)

    def complete(self, fun: FunSymbol) -> bool:
        """Whether the function and all it calls are free of errors and of recursion."""
        below = list(self._below(fun))
        self._walk(fun)
        return not any(f in self._broken or f in self._recursive for f in below)

    def extern_below(self, fun: FunSymbol) -> FunSymbol | None:
        """An extern function that a call would reach."""
        return next((f for f in self._below(fun) if f.extern), None)

    def param_below(self, fun: FunSymbol) -> tuple[ParamSymbol, Span] | None:
        """A parameter that a call would read, and where."""
        return next((self._params[f] for f in self._below(fun) if f in self._params), None)

    # ------------------------------------------------------------ recursion

    def report_recursion(self) -> None:
        """T006 for every cycle that was not reported yet; all bodies have been checked."""
        for fun in list(self._calls):
            self._walk(fun)

    def _walk(self, root: FunSymbol) -> None:
        """Depth first over what was not walked yet; reports each cycle it meets."""
        if root in self._walked:
            return
        path: dict[FunSymbol, Span | None] = {root: None}
        iterators = [iter(self._calls.get(root, ()))]
        while iterators:
            step = next(iterators[-1], None)
            if step is None:
                iterators.pop()
                self._walked.add(path.popitem()[0])
                continue
            callee, span = step
            if callee in path:
                self._report(path, callee, span)
            elif callee not in self._walked:
                path[callee] = span
                iterators.append(iter(self._calls.get(callee, ())))

    def _report(self, path: dict[FunSymbol, Span | None], again: FunSymbol, closing: Span) -> None:
        funs = list(path)
        cycle = funs[funs.index(again) :]
        if any(f in self._recursive for f in cycle):
            return
        self._recursive.update(cycle)
        through = cycle[1:]
        shown = ", ".join(f"`{f.name}`" for f in through[:MAX_CALLS_SHOWN])
        more = len(through) - MAX_CALLS_SHOWN
        shown += f" and {more} more" if more > 0 else ""
        also = tuple(
            (span, f"calls `{f.name}` here")
            for f in through[:MAX_CALLS_SHOWN]
            if (span := path[f]) is not None
        )
        self.diagnostics.error(
            "T006",
            f"`{again.name}` calls itself" + (f" through {shown}" if through else ""),
            closing,
            "this call closes the circle" if through else "calls itself here",
            also=also,
            notes=("without recursion the time and the stack of every step have a bound",),
            helps=("write a `for` loop with a constant bound",),
        )
