"""The `verify` block of a module.

Purpose: grids, polytopes, abstractions, commands, times: what `soter verify` needs to know.
Non-goals: what the names mean (`language/check/parts/verify_block.py`).
"""

# ruff: noqa: SLF001 - the table at the end names the methods of the class before it

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.source import Span
from soter.language.syntax import tree
from soter.language.syntax.parsing import instance_arrays
from soter.language.syntax.parsing.bodies import BodyParser, OnceParts, predicate
from soter.language.syntax.tokens import NAME

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(slots=True)
class _ViewParts(OnceParts):
    groups: list[tree.AxisGroup] = field(default_factory=list)
    abstracts: list[tuple[tree.Name, tuple[tree.Abstraction, ...]]] = field(default_factory=list)


@dataclass(slots=True)
class _VerifyParts(_ViewParts):
    commands: list[tree.CommandSet] = field(default_factory=list)
    views: list[tree.View] = field(default_factory=list)
    lemmas: list[tree.SyntaxExpr] = field(default_factory=list)
    progress: list[tree.SyntaxExpr] = field(default_factory=list)


class VerifyParser(BodyParser):
    """The part of the parser that reads `verify` blocks."""

    __slots__ = ()

    def _verify(self, parts: OnceParts) -> None:
        at = self.i
        self.i += 1
        inner = _VerifyParts()
        self.body("this `verify` block", inner, _VERIFY_ITEMS)
        once = inner.once.get
        recover = once("recover")
        least, most = once("acts") or (None, None)
        block = tree.VerifyBlock(
            groups=tuple(inner.groups),
            abstracts=tuple(inner.abstracts),
            commands=tuple(inner.commands),
            core=once("core"),
            horizon=once("horizon"),
            levels=once("levels"),
            late=once("late"),
            response=once("response"),
            acts_least=least,
            acts=most,
            recover=None if isinstance(recover, Span) else recover,
            stays=recover if isinstance(recover, Span) else None,
            dropout=once("dropout"),
            views=tuple(inner.views),
            induction=once("induction"),
            lemmas=tuple(inner.lemmas),
            progress=tuple(inner.progress),
            enters=once("enters"),
            span=self.span_from(self.starts[at]),
        )
        self.keep_once(parts, "verify", block, at)

    def _view(self, parts: _VerifyParts) -> None:
        at = self.i
        self.i += 1
        name = self.name("the name of a view")
        inner = _ViewParts()
        self.body(f"view `{name.text}`", inner, _VIEW_ITEMS)
        span = self.span_from(self.starts[at])
        parts.views.append(tree.View(name, tuple(inner.groups), tuple(inner.abstracts), span))

    # ------------------------------------------------------------ groups of axes

    def _grid(self, parts: _ViewParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        axes: list[tree.GridAxis] = []
        while True:
            path = instance_arrays.path(self, "a topic or one of its fields")
            self.expect("in", "after the axis")
            interval = self.range_of("the range of the axis")
            self.expect("/", "and the number of cells after the range of the axis")
            cells = self.expr("the number of cells")
            end, is_open = None, self.accept_word("open")
            if is_open and self.kinds[self.i] not in (",", ";"):
                self.expect_word("to", "after `open`")
                end = self.expr("where an open axis ends")
            unbounded = is_open and end is None
            axes.append(tree.GridAxis(path, interval, cells, end, unbounded))
            if not self.accept(","):
                break
        self.semicolon("the grid")
        parts.groups.append(tree.AxisGroup("grid", tuple(axes), self.span_from(start)))

    def _polytope(self, parts: _ViewParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        axes: list[tree.GridAxis] = []
        while True:
            path = instance_arrays.path(self, "a state or a field of a topic")
            interval = self.range_of("the range of the axis") if self.accept("in") else None
            axes.append(tree.GridAxis(path, interval, None))
            if not self.accept(","):
                break
        self.semicolon("the polytope")
        parts.groups.append(tree.AxisGroup("polytope", tuple(axes), self.span_from(start)))

    # ------------------------------------------------------------ commands, abstractions

    def _commands(self, parts: _VerifyParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        path = instance_arrays.path(self, "an output topic or one of its fields")
        self.expect("in", "after the output")
        self.expect("{", "before the commands")
        values = [self.expr("a command")]
        while self.accept(","):
            values.append(self.expr("a command"))
        self.expect("}", "after the commands")
        self.semicolon("the commands")
        parts.commands.append(tree.CommandSet(path, tuple(values), self.span_from(start)))

    def _abstracts(self, parts: _ViewParts) -> None:
        self.i += 1
        name = self.name("the name of a plant after `abstracts`")
        if not self.is_word("by") and self.kinds[self.i : self.i + 2] == [NAME, NAME]:
            self.report("S005", f"expected `by` after the abstracted plant, found {self.found()}")
            self.i += 1
        else:
            self.expect_word("by", "after the abstracted plant")
        pairs: list[tree.Abstraction] = []
        while True:
            instance = self.name("the name of an abstraction")
            self.expect(":", "after the name of the abstraction")
            plant = self.ref("the name of a plant")
            self.assign("after the abstract plant")
            value = self.expr("the abstract state")
            pairs.append(tree.Abstraction(instance, plant, value))
            if not self.accept(","):
                break
        parts.abstracts.append((name, tuple(pairs)))
        self.semicolon("the abstractions")

    # ------------------------------------------------------------ induction

    def _induction(self, parts: _VerifyParts) -> None:
        at = self.i
        self.i += 1
        self.semicolon("`induction`")
        self.keep_once(parts, "induction", self.span_from(self.starts[at]), at)

    def _lemma(self, parts: _VerifyParts) -> None:
        self.i += 1
        parts.lemmas.append(self.expr("the lemma"))
        self.semicolon("the lemma")

    def _progress(self, parts: _VerifyParts) -> None:
        self.i += 1
        parts.progress.append(self.expr("what progress rests on"))
        self.semicolon("what progress rests on")

    # ------------------------------------------------------------ times

    def _delays(self, parts: _VerifyParts) -> None:
        at = self.i
        word = "response" if self.texts[at] == "response" else "late"
        self.i += 1
        time_by_role: dict[str, tree.SyntaxExpr] = {}
        nodes: list[tuple[tree.DottedPath, tree.SyntaxExpr]] = []
        while True:
            role = self.texts[self.i]
            if not (role[:1].isalpha() or role[:1] == "_") or role in time_by_role:
                message = f"expected `dm`, `sc` or a node and a time, found {self.found()}"
                raise self.failure("S005", message, helps=(f"write `{word} dm 1ms, sc 1ms;`",))
            if role in ("dm", "sc"):
                self.i += 1
                time_by_role[role] = self.time(f"`{role}`")
            else:
                path = self.path("a node between plant and module")
                nodes.append((path, self.time(f"`{path.text}`")))
            if not self.accept(","):
                break
        self.semicolon(f"the times of `{word}`")
        delays = tree.Delays(time_by_role.get("dm"), time_by_role.get("sc"), tuple(nodes))
        self.keep_once(parts, word, delays, at)

    def _dropout(self, parts: _VerifyParts) -> None:
        at = self.i
        self.i += 1
        self.keep_once(parts, "dropout", self.time_value("`dropout`"), at)

    def _acts(self, parts: _VerifyParts) -> None:
        """`acts within 10ms;`, or `acts within 1ms to 10ms;`."""
        at = self.i
        self.i += 1
        self.expect_word("within", "after `acts`")
        least, most = None, self.time("`within`")
        if self.texts[self.i] == "to":
            self.i += 1
            least, most = most, self.time("`to`")
        self.semicolon("`within`")
        self.keep_once(parts, "acts", (least, most), at)

    def _recover(self, parts: _VerifyParts) -> None:
        """`recover within 10s;`, or `recover never;`: SC may stop for good."""
        at = self.i
        self.i += 1
        if self.texts[self.i] != "never":
            self.expect_word("within", "after `recover`")
            self.keep_once(parts, "recover", self.time_value("`within`"), at)
            return
        self.i += 1
        self.semicolon("`recover never`")
        self.keep_once(parts, "recover", self.span_from(self.starts[at]), at)


_VIEW_ITEMS: dict[str, Callable[[VerifyParser, _ViewParts], None]] = {
    "grid": VerifyParser._grid,
    "polytope": VerifyParser._polytope,
    "abstracts": VerifyParser._abstracts,
}
_VERIFY_ITEMS: dict[str, Callable[[VerifyParser, _VerifyParts], None]] = {
    "grid": VerifyParser._grid,
    "polytope": VerifyParser._polytope,
    "abstracts": VerifyParser._abstracts,
    "view": VerifyParser._view,
    "commands": VerifyParser._commands,
    "core": predicate("core", "the core"),
    "enters": predicate("enters", "where views are entered"),
    "horizon": predicate("horizon", "the horizon"),
    "levels": predicate("levels", "the levels"),
    "late": VerifyParser._delays,
    "response": VerifyParser._delays,
    "acts": VerifyParser._acts,
    "recover": VerifyParser._recover,
    "dropout": VerifyParser._dropout,
    "induction": VerifyParser._induction,
    "lemma": VerifyParser._lemma,
    "progress": VerifyParser._progress,
}
