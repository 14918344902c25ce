"""The modes of other modules, and margins: of each a proof takes any value at any read.

Purpose: `modes_as_topics`: a module whose SC, `ttf` or `safer` reads `mode(M)` of another one, or
`margin(M)` of any, reads a topic in its place that nobody of the proof drives; for whom P2b waits,
and whether those wait in turn (docs/proof-modules.md, Coordinated switching).
Non-goals: `safe`, `core` and lemmas, in which none of these may stand; one's own mode; the
re-checker, which reads `mode` by itself and refuses `margin`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.system import Bound, Topic
from soter.language.model.tree_walk import nodes, rewritten, topic_reads
from soter.language.model.types import FLOAT, MODE
from soter.verify.problem.assumption import Assumption

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component, Module, Scope, System

    Read = tuple[str, typed.ModuleSymbol | str]
    Names = tuple[tuple[Read, typed.TopicSymbol], ...]

READS: dict[type, str] = {typed.ModeRead: "mode", typed.MarginRead: "margin"}
"""What is read of a module."""
SC, AC = MODE.members.index("SC"), MODE.members.index("AC")


@dataclass(frozen=True)
class Modes:
    """Whose modes a module reads.

    `topics`: what stands for a mode -> the name of its module; `margins`: what stands for a margin
    -> what is assumed of it; `waits`: whose modes `safer` reads; `never`: why nothing shows that
    all of these are in AC at some time; "": nothing speaks against.
    """

    topics: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    margins: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    waits: tuple[str, ...] = ()
    never: str = ""

    @property
    def assumptions(self) -> list[Assumption]:
        """What is not restricted, and what P2b rests on."""
        assumptions = [
            Assumption(f"mode {name}", f"mode({name}): SC or AC, anew at every read")
            for name in self.topics.values()
        ]
        assumptions += [Assumption(f"margin {t.name}", text) for t, text in self.margins.items()]
        if self.waits:
            text = (
                f"for P2b alone: {said(self.waits)} in AC; otherwise `safer` may not hold and SC "
                "keeps control"
            )
            assumptions.append(Assumption("waits", text))
        if self.never:
            text = f"for P2b nothing can be assumed: {self.never}"
            assumptions.append(Assumption("waits for ever", text))
        return assumptions


NO_MODES = Modes()


def said(names: tuple[str, ...]) -> str:
    """`A is`, or `A and B are`."""
    *most, last = names
    return f"{', '.join(most)} and {last} are" if most else f"{last} is"


def modes_as_topics(flat: System, module: Module) -> tuple[System, Module, Modes]:
    """The system with a topic for every other mode, and every margin, that a module reads.

    In SC, `ttf` or `safer`. The module and its SC read these topics; nobody publishes them. Without
    such reads everything stays as it is.
    """
    sc = flat.components[module.sc]
    asked = _asked(flat, module, sc)
    if not asked:
        return flat, module, NO_MODES
    names: Names = tuple((read, _symbol(read[0], m.name, m.symbol)) for read, m in asked.items())
    of = {topic: (read[0], asked[read]) for read, topic in names}
    at = {t: len(flat.topics) + k for k, t in enumerate(of)}
    made = [_topic(index, t, *of[t]) for t, index in at.items()]
    topics = list(at)
    symbol = _module(module.symbol, names)
    reads = tuple(t for t in topics if t in symbol.topics_read)
    derived_module = derived_systems.reading(
        module,
        [at[t] for t in reads],
        symbol=symbol,
        scope=_beside(module.scope, at),
        whole=None if module.whole is None else _module(module.whole, names),
    )
    dm = replace(flat.components[module.dm], scope=derived_module.scope)
    assert sc.node is not None
    controller = replace(sc, node=_node(sc.node, names), scope=_beside(sc.scope, at))
    system = derived_systems.with_module(derived_systems.with_topics(flat, made), derived_module)
    system = derived_systems.with_components(system, [dm, controller])
    waits = _read_in(module, "safer")
    return (
        system,
        derived_module,
        Modes(
            {t: m.name for t, m in _read_as("mode", of).items()},
            {t: _any_margin(m) for t, m in _read_as("margin", of).items()},
            tuple(flat.modules[i].name for i in waits),
            _never(flat, module, waits),
        ),
    )


def _topic(index: int, symbol: typed.TopicSymbol, kind: str, of: Module) -> Topic:
    """What stands for the mode or margin of a module."""
    is_mode = kind == "mode"
    return Topic(
        index=index,
        name=symbol.name,
        symbol=symbol,
        type=MODE if is_mode else FLOAT,
        bounds=(None if is_mode else Bound(0.0, _longest_s(of)),),
        set_declared=True,
        default=SC if is_mode else 0.0,
        max_age_ns=None,
        driver=of.name,
    )


def _longest_s(of: Module) -> float:
    """No margin of a module is longer, whatever it counts."""
    return max(of.levels - 1, 1) * of.period_ns / 1e9


def _any_margin(of: Module) -> str:
    return f"margin({of.name}): 0 to {_longest_s(of):g} s, anew at every read"


def in_ac(e: typed.TypedExpr, modes: Modes) -> typed.TypedExpr:
    """An expression where all modes of others are AC."""

    def instead(part: typed.TypedExpr) -> typed.TypedExpr:
        if isinstance(part, typed.TopicRead) and part.topic in modes.topics:
            return typed.Literal(MODE, part.span, AC)
        return part

    expression: typed.TypedExpr = rewritten(e, instead)
    return expression


# ---------------------------------------------------------------- who waits for whom


def _asked(flat: System, module: Module, sc: Component) -> dict[Read, Module]:
    own = {**sc.scope.modules, **module.scope.modules}
    return {
        (kind, s): flat.modules[own[s]]
        for kind, s in _read_by(module, sc)
        if s in own and (kind == "margin" or own[s] != module.index)
    }


def _read_as(
    kind: str, of: Mapping[typed.TopicSymbol, tuple[str, Module]]
) -> dict[typed.TopicSymbol, Module]:
    return {t: m for t, (read, m) in of.items() if read == kind}


def _read_by(module: Module, sc: Component) -> list[Read]:
    symbol, node = module.symbol, sc.node
    assert node is not None
    code = () if node.extern else (*node.step, *(node.takeover or ()))
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    reads: dict[Read, None] = {}
    for n in nodes((*code, *predicates)):
        if isinstance(n, (typed.ModeRead, typed.MarginRead)):
            reads[READS[type(n)], n.module] = None
    return list(reads)


def _read_in(module: Module, *predicates: str) -> list[int]:
    """The modules whose modes these predicates of a module read, without itself."""
    symbol = module.symbol if module.whole is None else module.whole
    said = [e for e in (getattr(symbol, p) for p in predicates) if e is not None]
    read = [n.module for n in nodes(said) if isinstance(n, typed.ModeRead)]
    indices = [module.scope.modules.get(s, module.index) for s in read]
    return [i for i in dict.fromkeys(indices) if i != module.index]


def _never(flat: System, module: Module, waits: list[int]) -> str:
    """Why those that a module waits for may never be in AC together, in words.

    One is forced to SC; or what one of them decides hangs, through any modes, on this module, which
    is in SC while it waits.
    """
    for i in waits:
        there = flat.modules[i]
        if there.forced == "sc":
            return f"{there.name} is forced to SC"
        seen, todo = {i}, [i]
        while todo:
            here = flat.modules[todo.pop()]
            for k in _read_in(here, "ttf", "safer"):
                if k == module.index:
                    return (
                        f"{module.name} waits for {there.name} to be in AC, whose DM goes by "
                        f"the mode of {module.name}: each may wait for the other for ever"
                    )
                todo += [k] if k not in seen else []
                seen.add(k)
    return ""


# ---------------------------------------------------------------- the same for the same, always


@lru_cache(maxsize=256)
def _symbol(kind: str, name: str, module: typed.ModuleSymbol) -> typed.TopicSymbol:
    """Symbols are compared by identity: the same for the same module, as are those below."""
    if kind == "mode":
        return typed.TopicSymbol(f"{name}.mode", module.span, MODE, False, {}, None, None)
    return typed.TopicSymbol(f"{name}.any_margin", module.span, FLOAT, False, {}, None, None)


@lru_cache(maxsize=256)
def _module(symbol: typed.ModuleSymbol, names: Names) -> typed.ModuleSymbol:
    ttf, safer = (None if e is None else _of(e, names) for e in (symbol.ttf, symbol.safer))
    read = topic_reads(*(e for e in (ttf, safer) if e is not None))
    more = tuple(t for t in dict(names).values() if t in read)
    more = tuple(dict.fromkeys(more))
    return replace(symbol, ttf=ttf, safer=safer, topics_read=(*symbol.topics_read, *more))


@lru_cache(maxsize=256)
def _node(node: typed.NodeSymbol, names: Names) -> typed.NodeSymbol:
    if node.extern:
        return node
    step = _of(node.step, names)
    takeover = None if node.takeover is None else _of(node.takeover, names)
    read = topic_reads(*step, *(takeover or ()))
    heard = dict.fromkeys(t for _, t in names if t in read)
    more = tuple(typed.Subscribed(t, None, "", node.span) for t in heard)
    return replace(node, step=step, takeover=takeover, subscribes=(*node.subscribes, *more))


def _of(code: Any, names: Names) -> Any:  # noqa: ANN401 - any part of a tree
    by = dict(names)

    def instead(part: Any) -> Any:  # noqa: ANN401 - any part of a tree
        kind = READS.get(type(part), "")
        if kind and (kind, part.module) in by:
            return typed.TopicRead(part.type, part.span, by[kind, part.module])
        return part

    return rewritten(code, instead)


def _beside(scope: Scope, topics: Mapping[typed.TopicSymbol, int]) -> Scope:
    return replace(scope, topics={**scope.topics, **topics})
