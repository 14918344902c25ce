"""Nodes and modules: the `node`, `extern node` and `rta` declarations.

Purpose: their bodies, item by item.
Non-goals: well-formedness of a module (P1a, P1b: `language/elaborate/wellformed.py`).
"""

# ruff: noqa: SLF001 - the tables at the end name the methods of the class before them

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import remove
from soter.language.syntax import tree
from soter.language.syntax.parsing import instance_arrays
from soter.language.syntax.parsing.bodies import OnceParts, predicate
from soter.language.syntax.parsing.verification import VerifyParser
from soter.language.syntax.tokens import ERROR, INT, NAME, visible

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Help
    from soter.diagnostics.source import Span


@dataclass(slots=True)
class _NodeParts(OnceParts):
    subscribes: list[tree.Subscription] = field(default_factory=list)
    publishes: list[tree.Publication] = field(default_factory=list)
    failsafe: list[tuple[tree.Ref, tree.SyntaxExpr]] = field(default_factory=list)
    locals: list[tree.LocalVar] = field(default_factory=list)
    assumes: list[tree.SyntaxExpr] = field(default_factory=list)
    guarantees: list[tree.SyntaxExpr] = field(default_factory=list)


@dataclass(slots=True)
class _RtaParts(OnceParts):
    contract: list[tree.Clause] = field(default_factory=list)
    failsafe: list[tuple[tree.Ref, tree.SyntaxExpr]] = field(default_factory=list)


class NodeParser(VerifyParser):
    """The part of the parser that reads nodes and modules."""

    __slots__ = ()

    # ------------------------------------------------------------ nodes

    def _node(self) -> tree.Decl:
        start = self.starts[self.i]
        extern = self.accept("extern")
        self.i += 1
        name = self.declare("the name of the node")
        period = self.period("node", name)
        phase = self.time("`phase`") if self.accept("phase") else None
        source, source_span = self.origin() if extern else self.stray_origin("node")
        parts = _NodeParts()
        what = f"node `{visible(name.text)}`"
        self.body(what, parts, _NODE_ITEMS)
        step = parts.once.get("step")
        if extern and step is not None:
            self._misplaced(
                "S025",
                f"the extern {what} has a `step`",
                parts.first["step"],
                self.not_extern(start, source_span),
                remove(parts.first["step"].to(step.span), "or leave the step out"),
            )
            step = None
        if not extern and step is None and not self.damaged:
            self._misplaced(
                "S024",
                f"{what} has no `step`",
                name.span,
                "add `step { ... }`, or declare it `extern node`",
            )
            self.damaged = True
        return tree.NodeDecl(
            name,
            self.span_from(start),
            period=period,
            phase=phase,
            extern=extern,
            source=source,
            source_span=source_span,
            subscribes=tuple(parts.subscribes),
            publishes=tuple(parts.publishes),
            failsafe=tuple(parts.failsafe),
            locals=tuple(parts.locals),
            assumes=tuple(parts.assumes),
            guarantees=tuple(parts.guarantees),
            takeover=parts.once.get("on takeover"),
            step=step,
            takes=parts.once.get("takes"),
            wcet=parts.once.get("wcet"),
            jitter=parts.once.get("jitter"),
        )

    def _misplaced(self, code: Code, message: str, span: Span, *helps: Help) -> None:
        quiet, self.quiet = self.quiet, -1
        self.report(code, message, span, helps=helps)
        self.quiet = quiet

    def _subscribes(self, parts: _NodeParts) -> None:
        self.i += 1
        while True:
            start = self.starts[self.i]
            topic = self.ref("the name of a topic")
            queue: int | None = None
            policy: str | None = None
            if self.accept_word("queue"):
                queue = self._count("the length of the queue")
                policy = self._policy()
            span = self.span_from(start)
            parts.subscribes.append(tree.Subscription(topic, queue, policy, span))
            if not self.accept(",") and not self._forgotten_comma():
                break
        self.semicolon("the subscriptions")

    def _count(self, what: str) -> int | None:
        i = self.i
        if self.kinds[i] == INT and len(self.texts[i]) <= 9:
            self.i += 1
            return int(self.texts[i])
        if self.kinds[i] in (INT, ERROR):
            self.report("L005", f"this number is too large for {what}")
            self.i += 1
            return None
        raise self.failure("S005", f"expected {what} as a whole number, found {self.found()}")

    def _policy(self) -> str | None:
        """What a full queue does, where it is said."""
        word = self.texts[self.i]
        if word in ("drop_oldest", "drop_newest", "fault"):
            self.i += 1
            return word
        if self.kinds[self.i] != NAME or self.new_line() or word in self.items:
            return None
        self.report(
            "S005",
            f"expected `;` or what a full queue does, found {self.found()}",
            helps=("the policies are `drop_oldest`, `drop_newest` and `fault`",),
        )
        self.i += 1
        return None

    def _publishes(self, parts: _NodeParts) -> None:
        self.i += 1
        while True:
            start = self.starts[self.i]
            topic = self.ref("the name of a topic")
            burst = self._burst() if self.kinds[self.i] == "[" else None
            parts.publishes.append(tree.Publication(topic, burst, self.span_from(start)))
            if not self.accept(",") and not self._forgotten_comma():
                break
        self.semicolon("the published topics")

    def _burst(self) -> int | None:
        """`[<=4]`: how many messages a step may publish."""
        self.tight.append(self.i)
        self.i += 1
        if self.kinds[self.i] != "<=":
            message = f"expected `<=` before the number of messages, found {self.found()}"
            helps = ("a topic of which a step may publish up to four messages: `alarm[<=4]`",)
            raise self.failure("S005", message, helps=helps)
        self.i += 1
        count = self._count("the number of messages")
        self.expect("]", "after the number of messages")
        return count

    def _failsafe(self, parts: _NodeParts | _RtaParts) -> None:
        self.i += 1
        topic = self.ref("the name of a topic")
        self.assign("after the topic of `failsafe`")
        parts.failsafe.append((topic, self.value("the fail-safe value")))

    def _local(self, parts: _NodeParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("a name after `var`")
        type_ = self.typed("the variable")
        initial: tree.SyntaxExpr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("after the type of the variable")
            initial = self.value("the initial value")
        else:
            self.no_initial("the type of the variable")
        parts.locals.append(tree.LocalVar(name, type_, initial, self.span_from(start)))

    def _assumes(self, parts: _NodeParts) -> None:
        self.i += 1
        parts.assumes.append(self.value("the assumption"))

    def _guarantees(self, parts: _NodeParts) -> None:
        self.i += 1
        parts.guarantees.append(self.value("the guarantee"))

    def _takes(self, parts: _NodeParts) -> None:
        """`takes [50ms, 400ms];`: how long a step lasts."""
        at = self.i
        self.i += 1
        interval = self.range_of("how long a step takes")
        self.semicolon("how long a step takes")
        self.keep_once(parts, "takes", interval, at)

    def _budget(self, parts: OnceParts) -> None:
        """`wcet 200us;` and `jitter 50us;` of a node, or of the decision module of an `rta`."""
        at = self.i
        word = "jitter" if self.texts[at] == "jitter" else "wcet"
        self.i += 1
        self.keep_once(parts, word, self.time_value(f"`{word}`"), at)

    def _on(self, parts: _NodeParts) -> None:
        at = self.i
        self.i += 1
        self.expect_word("takeover", "after `on`")
        self.keep_once(parts, "on takeover", self.block("after `on takeover`"), at)

    def _step(self, parts: _NodeParts) -> None:
        at = self.i
        self.i += 1
        self.keep_once(parts, "step", self.block("after `step`"), at)

    # ------------------------------------------------------------ modules

    def _rta(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the module")
        parts = _RtaParts()
        self.body(f"module `{visible(name.text)}`", parts, _RTA_ITEMS)
        once = parts.once.get
        return tree.RtaDecl(
            name,
            self.span_from(start),
            ac=once("ac"),
            sc=once("sc"),
            period=once("period"),
            safe=once("safe"),
            safer=once("safer"),
            ttf=once("ttf"),
            clean=once("clean"),
            verify=once("verify"),
            contract=tuple(parts.contract),
            failsafe=tuple(parts.failsafe),
            wcet=once("wcet"),
            jitter=once("jitter"),
            returns=once("returns"),
            shield=once("shield", (None, False))[0],
            toward_sc=once("shield", (None, False))[1],
            rest=once("rest"),
        )

    def _clause(self, parts: _RtaParts) -> None:
        """`assumes name: e;` and `guarantees name: e;`."""
        start = self.starts[self.i]
        kind = "assumes" if self.texts[self.i] == "assumes" else "guarantees"
        what = "the assumption" if kind == "assumes" else "the guarantee"
        self.i += 1
        if self.kinds[self.i] != NAME or self.kinds[self.i + 1] != ":":
            raise self.failure(
                "S005",
                f"expected a name and `:` after `{kind}`, found {self.found()}",
                notes=("reports tell the clauses of a module's contract by their names",),
                helps=(f"write `{kind} bounded: ...;`",),
            )
        name = self.name(f"the name of {what}")
        self.expect(":", f"after the name of {what}")
        condition = self.value(what)
        parts.contract.append(tree.Clause(kind, name, condition, self.span_from(start)))

    def _controller(self, parts: OnceParts) -> None:
        at = self.i
        word = self.texts[at] if self.texts[at] in ("ac", "sc") else "ac"
        self.i += 1
        if word == "sc" and self.is_word("synthesized") and self.kinds[self.i + 1] != ".":
            self.keep_once(parts, word, self._synthesized(), at)
            return
        if word == "ac" and self.is_word("module") and self.kinds[self.i + 1] == NAME:
            self.keep_once(parts, word, self._module_as_ac(), at)
            return
        node = self.ref(f"the name of a node after `{word}`")
        self.semicolon(f"the node of `{word}`")
        self.keep_once(parts, word, node, at)

    def _module_as_ac(self) -> tree.ModuleAsAc:
        """`ac module Keep;`: what AC is, is itself a module."""
        start = self.starts[self.i]
        self.i += 1
        module = self.ref("the name of a module after `ac module`")
        controller = tree.ModuleAsAc(module, self.span_from(start))
        self.semicolon("the module of `ac`")
        return controller

    def _synthesized(self) -> tree.Synthesized:
        """`sc synthesized period 10ms;`: there is none yet."""
        start = self.starts[self.i]
        self.i += 1
        self.expect_word("period", "after `synthesized`")
        period = self.time_value("`period`")
        return tree.Synthesized(period, self.span_from(start))

    def _returns(self, parts: OnceParts) -> None:
        """`returns after button;`, or `returns never;`: the latch."""
        at = self.i
        self.i += 1
        topic: tree.Ref | None = None
        if not self.accept_word("never"):
            self.expect_word("after", "or `never` after `returns`")
            topic = self.ref("the name of a topic after `returns after`")
        self.semicolon("`returns`")
        returns = tree.Returns(topic, self.span_from(self.starts[at]))
        self.keep_once(parts, "returns", returns, at)

    def _shield(self, parts: OnceParts) -> None:
        """`shield 8;`, `shield 8 toward sc;`, or `shield;`."""
        at = self.i
        self.i += 1
        what = "the value of `shield`"
        no_number = self.kinds[self.i] == ";" or self.texts[self.i : self.i + 2] == ["toward", "sc"]
        cells = None if no_number else self.expr(what)
        toward = self.accept_word("toward")
        if toward:
            self.expect_word("sc", "after `toward`")
        if cells is None:
            self.semicolon("`shield`")
            kept: object = tree.EachCommand(self.span_from(self.starts[at]))
        else:
            kept = self.ended(cells, what)
        self.keep_once(parts, "shield", (kept, toward), at)

    def _rest(self, parts: OnceParts) -> None:
        """`rest e moves x by d, gap by d down within T;`."""
        at = self.i
        self.i += 1
        condition = self.expr("the condition of `rest`")
        moves: list[tree.Move] = []
        if self.accept_word("moves"):
            while True:
                path = instance_arrays.path(self, "a topic or one of its fields")
                self.expect_word("by", "and how far, behind what moves")
                by = self.expr("how far it moves")
                way = next((w for w in ("down", "up") if self.accept_word(w)), "")
                moves.append(tree.Move(path, by, way))
                if not self.accept(","):
                    break
        self.expect_word("within", "and a time at the end of `rest`")
        within = self.time_value("the time of `rest`")
        rest = tree.Rest(condition, tuple(moves), within, self.span_from(self.starts[at]))
        self.keep_once(parts, "rest", rest, at)

    def _module_period(self, parts: OnceParts) -> None:
        at = self.i
        self.i += 1
        self.keep_once(parts, "period", self.time_value("`period`"), at)


_NODE_ITEMS: dict[str, Callable[[NodeParser, _NodeParts], None]] = {
    "subscribes": NodeParser._subscribes,
    "publishes": NodeParser._publishes,
    "takes": NodeParser._takes,
    "wcet": NodeParser._budget,
    "jitter": NodeParser._budget,
    "failsafe": NodeParser._failsafe,
    "var": NodeParser._local,
    "assumes": NodeParser._assumes,
    "guarantees": NodeParser._guarantees,
    "on": NodeParser._on,
    "step": NodeParser._step,
}
_RTA_ITEMS: dict[str, Callable[[NodeParser, _RtaParts], None]] = {
    "ac": NodeParser._controller,
    "sc": NodeParser._controller,
    "period": NodeParser._module_period,
    "wcet": NodeParser._budget,
    "jitter": NodeParser._budget,
    "safe": predicate("safe", "the safe condition"),
    "safer": predicate("safer", "the safer condition"),
    "ttf": predicate("ttf", "the ttf condition"),
    "clean": predicate("clean", "the value of `clean`"),
    "returns": NodeParser._returns,
    "shield": NodeParser._shield,
    "rest": NodeParser._rest,
    "failsafe": NodeParser._failsafe,
    "assumes": NodeParser._clause,
    "guarantees": NodeParser._clause,
    "verify": NodeParser._verify,
}
