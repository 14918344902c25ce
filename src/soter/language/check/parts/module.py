"""Checks RTA modules: (N_ac, N_sc, N_dm, Delta, phi_safe, phi_safer) of the paper.

Purpose: turns an `rta` declaration into a `ModuleSymbol`; `verify_block.py` adds `verify`.
Non-goals: P1a and P1b (`wellformed.py`), P2 and P3 (`verify/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.checker_interface import Context
from soter.language.check.dots_and_brackets import hint_to_one_number, quoted
from soter.language.check.expression_base import CheckerPart, has_error
from soter.language.check.parts.node import period_or_unknown
from soter.language.check.parts.plans import sc_and_its_topic, set_step_from_plans
from soter.language.check.parts.verify_block import VerifyChecker
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.types import BOOL, DURATION, FLOAT, INT, ErrorType, FloatType
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.language.check.checker_interface import Shared
    from soter.language.check.scope import FileScope


class ModuleChecker(CheckerPart):
    """Checks modules of one program."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(shared)
        self.verification = VerifyChecker(shared)

    def _node_of(self, ref: tree.Ref | None, scope: FileScope) -> typed.NodeSymbol | None:
        return self.referred_symbol(ref, scope, "node", typed.NodeSymbol) if ref else None

    def _nodes_of(
        self, refs: tuple[tree.Ref, ...], scope: FileScope
    ) -> list[typed.NodeSymbol | None]:
        return [self._node_of(ref, scope) for ref in refs]

    def _node_of_sc(
        self, sc: tree.Ref | tree.Synthesized | None, ac: typed.NodeSymbol | None, context: Context
    ) -> typed.NodeSymbol | None:
        if isinstance(sc, tree.Synthesized):
            return self._synthesized_node(sc, ac, context)
        return self._node_of(sc, context.scope)

    def symbol_of(
        self, decl: tree.RtaDecl, scope: FileScope, full_name: str
    ) -> typed.ModuleSymbol | None:
        """Gives the symbol of a module with checked controllers and period; None without one."""
        context = Context(scope, f"the declaration of module `{decl.name.text}`")
        parts = {"ac": decl.ac, "sc": decl.sc, "period": decl.period, "safe": decl.safe}
        missing = [word for word, part in parts.items() if part is None]
        if missing and decl.name.text not in scope.broken:
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` has no " + " and no ".join(f"`{m}`" for m in missing),
                decl.name.span,
                notes=("a module is an advanced and a safe controller, a period and a property",),
                helps=(_text_of_missing_clauses(decl, scope, missing),),
            )
        number = self.check_number_if_given
        ac = self._node_of(decl.ac, scope)
        plans = self._nodes_of(decl.plans, scope)
        sc, plan = sc_and_its_topic(full_name, plans)
        if not plans:
            sc = self._node_of_sc(decl.sc, ac, context)
        subject, period_expr = "a period", decl.period
        period = (
            None
            if period_expr is None
            else self.shared.check_number(period_expr, context, DURATION, subject)
        )
        counts = decl.name.span, "`clean` counts outputs of AC, as in `clean 5;`"
        clean = number(decl.clean, context, INT, "`clean`", counts)
        shield = self._check_shield(decl, context)
        wcet = number(decl.wcet, context, DURATION, "`wcet`")
        jitter = number(decl.jitter, context, DURATION, "`jitter`")
        if decl.ac is None or decl.sc is None or decl.safe is None:
            return None
        if ac is None or sc is None or period is None:
            return None
        if {ac, sc, *plans} & self.shared.damaged:
            self.shared.names.losses += 1
        module = typed.ModuleSymbol(
            full_name,
            decl.name.span,
            ac=ac,
            sc=sc,
            period=period_or_unknown(period),
            safe=typed.Literal(BOOL, decl.safe.span, True),
            safer=None,
            ttf=None,
            clean=clean,
            verify=typed.TypedVerifyBlock(),
            ac_span=decl.ac.span,
            sc_span=decl.sc.span.to((decl.sc, *decl.plans)[-1].span),
            wcet=wcet,
            jitter=jitter,
            shield=shield,
            toward_sc=decl.toward_sc,
            plans=tuple(filter(None, plans)),
            plan=plan,
        )
        self.shared.check_body_later(module, decl, scope)
        return module

    def _check_shield(self, decl: tree.RtaDecl, context: Context) -> typed.TypedExpr | None:
        """Gives into how many cells commands are cut; reports M027 for `shield;` without `rest`."""
        if not isinstance(decl.shield, tree.EachCommand):
            return self.check_number_if_given(decl.shield, context, INT, "`shield`")
        if decl.rest is None and decl.name.text not in context.scope.broken:
            self.diagnostics.error(
                "M027",
                f"module `{decl.name.text}` has a shield that says no number, and no `rest`",
                decl.shield.span,
                notes=("on a grid it judges cells; only a module with `rest` follows SC",),
                helps=("say into how many cells each command is cut, as in `shield 8;`",),
            )
        return typed.Literal(INT, decl.shield.span, typed.CELLS_MAX)

    def _synthesized_node(
        self, decl: tree.Synthesized, ac: typed.NodeSymbol | None, context: Context
    ) -> typed.NodeSymbol | None:
        """Gives an extern node with AC's outputs, as placeholder for the SC to be synthesized."""
        period = self.shared.check_number(decl.period, context, DURATION, "a period")
        if ac is None or period is None:
            return None
        return typed.NodeSymbol(
            typed.SYNTHESIZED,
            decl.span,
            period=period_or_unknown(period),
            phase=None,
            extern=True,
            source=None,
            subscribes=(),
            publishes=ac.publishes,
            failsafe={},
            locals=(),
            initial=(),
            assumes=(),
            guarantees=(),
            takeover=None,
            step=(),
        )

    def check_body(self, module: typed.ModuleSymbol, decl: tree.RtaDecl, scope: FileScope) -> None:
        """Checks predicates, the other clauses and the `verify` block."""
        assert decl.safe is not None
        check = self.shared.check_expr
        where = f"module `{decl.name.text}`"
        context = Context(scope, where, topics="any", has_modes=True)
        if module.plan is not None:
            set_step_from_plans(module, decl, self.diagnostics)
        name = decl.name.span
        safe = name, "`safe` is the condition that must hold all the time"
        ttf = name, "`ttf` is the condition under which SC takes over, as in `ttf x > LIMIT;`"
        safer = name, "`safer` is the condition under which AC returns, as in `safer x < LIMIT;`"
        module.safe = check(decl.safe, context, BOOL, safe)
        context.topics_read = {}
        module.ttf = check(decl.ttf, context, BOOL, ttf) if decl.ttf else None
        module.safer = check(decl.safer, context, BOOL, safer) if decl.safer else None
        module.topics_read = tuple(context.topics_read)
        if decl.rest is not None:
            module.rest = self._check_rest(decl, decl.rest, scope)
        half = (decl.ttf is None) != (decl.safer is None) and decl.rest is None
        if half and decl.name.text not in scope.broken:
            missing, other = ("ttf", "safer") if decl.ttf is None else ("safer", "ttf")
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` has `{other}` but no `{missing}`",
                decl.name.span,
                notes=("one decides when to leave AC, the other when to return to it",),
                helps=(f"write `{missing}` too, or leave both out: then they are computed",),
            )
        module.contract = tuple(self._check_contract(module, decl, scope))
        module.failsafe = self._check_failsafe_law(module, decl, scope)
        if decl.candidates is not None:
            module.candidates = self.shared.topic_of_ref(decl.candidates, scope)
        if decl.returns is not None:
            module.latch = self._check_latch(module, decl, decl.returns, scope)
        if decl.verify is not None:
            self.verification.check(module, decl.verify, scope)

    def _check_rest(
        self, decl: tree.RtaDecl, rest: tree.Rest, scope: FileScope
    ) -> typed.RestSymbol | None:
        """Checks `rest`, a condition on plants' topics; reports M029 for excluded clauses."""
        where = f"`rest` of module `{decl.name.text}`"
        numbers = Context(scope, where)
        condition = self.shared.check_expr(
            rest.condition, Context(scope, where, topics="any"), BOOL
        )
        within = self.shared.check_number(rest.within, numbers, DURATION, "the time of `rest`")
        moves = [self._rest_move(item, numbers, scope) for item in rest.moves]
        first: dict[object, tree.Move] = {}
        for move, item in zip(moves, rest.moves, strict=True):
            if move is not None and first.setdefault((move.topic, move.path), item) is not item:
                self.diagnostics.error(
                    "N002",
                    f"`rest` says twice how far `{item.path.span.text}` moves",
                    item.path.span,
                    "again",
                    also=((first[move.topic, move.path].path.span, "the first time"),),
                )
        for word, other in _clauses_excluded_by_rest(decl):
            quoted = f"`{word}`" if " " not in word else f"the words {word}"
            self.diagnostics.error(
                "M029",
                f"module `{decl.name.text}` has `rest`, and `{word}`",
                other,
                also=((rest.span, "`rest`"),),
                notes=("with `rest` the DM follows SC from each estimate: nothing else decides",),
                helps=(
                    f"leave out {quoted}, or `rest`"
                    if not word.startswith("shield")
                    else "leave the number of `shield` out: SC is followed from each command",
                ),
            )
        sure = not has_error(condition) and self._reads_only_state(condition, decl)
        if not sure or has_error(within) or None in moves:
            return None
        kept = tuple(m for m in moves if m is not None)
        return typed.RestSymbol(condition, kept, within, rest.span)

    def _reads_only_state(self, condition: typed.TypedExpr, decl: tree.RtaDecl) -> bool:
        """Whether `rest` reads only the state; reports M029 if it reads ages or calls externs."""
        calls = self.shared.calls
        for node in nodes([condition]):
            if isinstance(node, typed.AgeRead):
                reads = f"reads the age of `{node.topic.name}`"
            elif isinstance(node, typed.TypedCall) and (f := calls.extern_called_by(node.fun)):
                reads = f"calls the extern `{f.name}`"
            else:
                continue
            self.diagnostics.error(
                "M029",
                f"`rest` of module `{decl.name.text}` {reads}",
                node.span,
                notes=("it is said of true states, wherever SC brings the robot",),
                helps=("say it of topics, constants and parameters",),
            )
            return False
        return True

    def _rest_move(
        self, item: tree.Move, context: Context, scope: FileScope
    ) -> typed.RestMove | None:
        """Checks how far a number of a topic may move in `rest`; reports T001 for no `float`."""
        by = self.shared.check_number(item.by, context, FLOAT, "how far it moves")
        place = self.shared.topic_of_path(item.path, scope)
        if place is None or has_error(by):
            return None
        topic, path, t = place
        if isinstance(t, FloatType):
            return typed.RestMove(topic, path, by, item.way, item.path.span)
        self.diagnostics.error(
            "T001",
            f"expected `float`, found `{t}`",
            item.path.span,
            "what moves is a `float`",
            helps=(hint_to_one_number(t, item.path),),
        )
        return None

    def _check_latch(
        self,
        module: typed.ModuleSymbol,
        decl: tree.RtaDecl,
        returns: tree.Returns,
        scope: FileScope,
    ) -> typed.Latch | None:
        """Checks `returns`; reports M028 unless its topic is a `bool` with a `max_age`."""
        if returns.topic is None:
            if decl.verify is not None and decl.verify.recover is not None:
                self.diagnostics.error(
                    "M028",
                    f"module `{module.name}` says `returns never`, and `recover within` a time",
                    decl.verify.recover.span,
                    also=((returns.span, "never"),),
                    notes=("with `returns never` nothing is asked of the way back (P2b)",),
                    helps=("leave `recover` out",),
                )
            return typed.Latch(None, returns.span)
        topic = self.shared.topic_of_ref(returns.topic, scope)
        if topic is None:
            return None
        lacks: list[tuple[str, str]] = []
        if topic.type != BOOL and not isinstance(topic.type, ErrorType):
            lacks.append(("is no `bool`", "declare it a `bool`: true while the button is pressed"))
        if topic.max_age is None:
            lacks.append(("has no `max_age`", "say how old a press may be: `max_age 2s`"))
        for lack, help_ in lacks[:1]:
            self.diagnostics.error(
                "M028",
                f"`{topic.name}` acknowledges for module `{module.name}`, but {lack}",
                returns.topic.span,
                also=((topic.span, "declared here"),),
                notes=("control comes back after a press that is new, and not older than said",),
                helps=(help_,),
            )
        return None if lacks else typed.Latch(topic, returns.span)

    def _check_failsafe_law(
        self, module: typed.ModuleSymbol, decl: tree.RtaDecl, scope: FileScope
    ) -> dict[typed.TopicSymbol, typed.TypedExpr]:
        """Checks the fail-safe law; reports M009 for a topic that is no output, M026 for a gap."""
        name = decl.name.text
        context = Context(scope, f"the fail-safe law of module `{name}`")
        value_by_topic: dict[typed.TopicSymbol, typed.TypedExpr] = {}
        spans: dict[typed.TopicSymbol, Span] = {}
        for ref, expr in decl.failsafe:
            topic = self.shared.topic_of_ref(ref, scope)
            wanted = topic.type if topic else None
            value = self.shared.check_number(expr, context, wanted, "a fail-safe value")
            if topic is None:
                continue
            if topic not in module.sc.publishes:
                self.diagnostics.error(
                    "M009",
                    f"module `{name}` does not publish `{ref.text}`",
                    ref.span,
                    notes=("the fail-safe law takes the place of what a module publishes",),
                    helps=(f"leave `{ref.text}` out",),
                )
            elif topic in spans:
                self.shared.names.report_duplicate(ref.text, ref.span, spans[topic])
            elif not has_error(value):
                value_by_topic[topic] = value
            spans.setdefault(topic, ref.span)
        left = [t.name for t in module.sc.publishes if t not in spans]
        if decl.failsafe and left and module.sc not in self.shared.damaged:
            self.diagnostics.error(
                "M026",
                f"the fail-safe law of module `{name}` says nothing of {quoted(left)}",
                decl.failsafe[0][0].span,
                also=((module.sc_span or module.span, "publishes it"),),
                notes=("when the lease ends all outputs of a module get a value at once",),
                helps=(f"add `failsafe {left[0]} = ...;`",),
            )
        return value_by_topic if not left else {}

    def _check_contract(
        self, module: typed.ModuleSymbol, decl: tree.RtaDecl, scope: FileScope
    ) -> Iterator[typed.ClauseSymbol]:
        where = f"the contract of module `{decl.name.text}`"
        context = Context(scope, where, topics="any", has_time=True, has_modes=True)
        seen: dict[str, Span] = {}
        for item in decl.contract:
            condition = self.shared.check_expr(item.condition, context, BOOL)
            if self.shared.names.enter_if_new(item.name, seen) and not has_error(condition):
                self._require_outputs(module, item, condition)
                text = item.condition.span.text_on_one_line
                yield typed.ClauseSymbol(item.name.text, item.span, item.kind, condition, text)

    def _require_outputs(
        self, module: typed.ModuleSymbol, item: tree.Clause, condition: typed.TypedExpr
    ) -> None:
        """Reports M022 for a guarantee that reads no output, or an assumption that reads one."""
        outputs = set(module.sc.publishes)
        read = topic_reads(condition)
        outputs_read = [e for t, e in read.items() if t in outputs]
        published = quoted([t.name for t in module.sc.publishes])
        also = ((module.span, f"publishes {published}"),)
        if item.kind == "guarantees" and not outputs_read:
            self.diagnostics.error(
                "M022",
                f"`{item.name.text}` says nothing of what module `{module.name}` publishes",
                item.condition.span,
                also=also,
                notes=("a module can promise what it publishes, and nothing that others do",),
                helps=(
                    "let the node that publishes it guarantee this",
                    "or state it as a property: `always ...;`",
                ),
            )
        elif item.kind == "assumes" and outputs_read:
            self.diagnostics.error(
                "M022",
                f"`{item.name.text}` assumes something of what module `{module.name}` publishes",
                outputs_read[0].span,
                also=also,
                notes=("a module relies on others, and answers for its own outputs",),
                helps=("write `guarantees`, or leave its outputs out",),
            )


def _clauses_excluded_by_rest(decl: tree.RtaDecl) -> Iterator[tuple[str, Span]]:
    """Yields the keyword and place of each clause, also in `verify`, that `rest` excludes."""
    for word in ("ttf", "safer", "shield"):
        part = getattr(decl, word)
        if part is not None and not isinstance(part, tree.EachCommand):
            yield word, part.span
    if decl.failsafe:
        yield "failsafe", decl.failsafe[0][0].span
    if isinstance(decl.sc, tree.Synthesized):
        yield "sc synthesized", decl.sc.span
    verify = decl.verify
    if verify is None:
        return
    yield from (("grid", group.span) for group in verify.groups)
    yield from (("view", view.span) for view in verify.views)
    words = ("levels", "levels"), ("enters", "enters"), ("core", "core")
    for word, field in (*words, ("recover within", "recover")):
        if (part := getattr(verify, field)) is not None:
            yield word, part.span
    if verify.induction is not None:
        yield "induction", verify.induction


def _nodes_with_outputs_of(name: str, scope: FileScope) -> list[str]:
    """Gives other nodes with the outputs of node `name`; if unknown, all nodes with outputs."""
    known = [e.decl for e in scope.entries.values() if isinstance(e.decl, tree.NodeDecl)]
    outputs = {d.name.text: {p.topic.text for p in d.publishes} for d in known}
    wanted = outputs.get(name)
    return [n for n, topics in outputs.items() if n != name and topics and wanted in (None, topics)]


def _text_of_missing_clauses(decl: tree.RtaDecl, scope: FileScope, missing: list[str]) -> str:
    """Gives a help text that names the missing clauses, and nodes of this file that fit."""
    other = next((p.text for p in (decl.ac, decl.sc) if isinstance(p, tree.Ref)), "")
    alike = _nodes_with_outputs_of(other, scope)
    examples = {"ac": "ac ...;", "sc": "sc ...;", "period": "period 50ms;", "safe": "safe ...;"}
    if other and alike:
        examples |= {"ac": f"ac {alike[0]};", "sc": f"sc {alike[0]};"}
    added = "add " + ", ".join(f"`{examples[m]}`" for m in missing)
    if other and not alike and {"ac", "sc"} & set(missing):
        added += f": a node that publishes what `{other}` does"
    return added
