"""What a proof takes of other modules: of the one above, and modes and margins of any.

Purpose: `with_module_above` gives the states at which the module above gives control back, as a
predicate over what the plants of the proof drive, and how old the state behind that verdict may be
once it is in force (docs/proof-modules.md, Towers); `handed_back` adds that age to the times.
`modes_as_topics` replaces `mode(M)` of another module, and `margin(M)` of any, in SC, `ttf` and
`safer` by a topic that nobody in the proof drives: it may have any value at any read. It also says
for which modules P2b waits, and whether those wait in turn (docs/proof-modules.md, Coordinated
switching).
Non-goals: that the state is then in R(H) (`claims/start.py`), what H has to be (`schedule.py`);
`safe`, `core` and lemmas, in which no mode or margin may stand; one's own mode; the re-checker,
which reads `mode` by itself and refuses `margin`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from typing import TYPE_CHECKING, Any

from soter.language.elaborate import derived_systems
from soter.language.elaborate.derived_systems import with_module
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.model import typed
from soter.language.model.system import Bound, Topic, modules_above
from soter.language.model.tree_walk import conjuncts, nodes, rewritten, topic_reads
from soter.language.model.types import FLOAT, MODE, show_ns
from soter.verify.problem.problem import NO_MODES, Assumption, Modes
from soter.verify.problem.problem_times import read_by_dm, read_by_sc, times_of
from soter.verify.problem.supported_constructs import UNKNOWN_FACTS
from soter.verify.problem.verification_system import place

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, Module, Scope, System
    from soter.verify.problem.problem import ProblemKind, Times
    from soter.verify.problem.verification_system import VerificationSystem

    Read = tuple[str, typed.ModuleSymbol | str]
    Names = tuple[tuple[Read, typed.TopicSymbol], ...]


READS: dict[type, str] = {typed.ModeRead: "mode", typed.MarginRead: "margin"}
"""The words for what is read of a module."""
SC, AC = MODE.members.index("SC"), MODE.members.index("AC")


def modes_as_topics(flat: System, module: Module) -> tuple[System, Module, Modes]:
    """The system with a topic for every other mode, and every margin, that a module reads.

    SC, `ttf` and `safer` read these topics instead; nobody publishes them. Without such reads the
    system stays as it is.
    """
    sc = flat.components[module.sc]
    asked = _modules_by_read(flat, module, sc)
    if not asked:
        return flat, module, NO_MODES
    names: Names = tuple((read, _symbol(read[0], m.name, m.symbol)) for read, m in asked.items())
    of = {topic: (read[0], asked[read]) for read, topic in names}
    at = {t: len(flat.topics) + k for k, t in enumerate(of)}
    made = [_topic_of_module(index, t, *of[t]) for t, index in at.items()]
    topics = list(at)
    symbol = _module(module.symbol, names)
    reads = tuple(t for t in topics if t in symbol.topics_read)
    derived_module = derived_systems.reading(
        module,
        [at[t] for t in reads],
        symbol=symbol,
        scope=_scope_with_topics(module.scope, at),
        whole=None if module.whole is None else _module(module.whole, names),
    )
    dm = replace(flat.components[module.dm], scope=derived_module.scope)
    assert sc.node is not None
    controller = replace(sc, node=_node(sc.node, names), scope=_scope_with_topics(sc.scope, at))
    system = derived_systems.with_module(derived_systems.with_topics(flat, made), derived_module)
    system = derived_systems.with_components(system, [dm, controller])
    waits = _modes_read_in(module, "safer")
    return (
        system,
        derived_module,
        Modes(
            {t: m.name for t, m in _modules_by_topic("mode", of).items()},
            {t: _margin_assumption(m) for t, m in _modules_by_topic("margin", of).items()},
            tuple(flat.modules[i].name for i in waits),
            _why_never_in_ac(flat, module, waits),
        ),
    )


def _topic_of_module(index: int, symbol: typed.TopicSymbol, kind: str, of: Module) -> Topic:
    """The topic that stands for the mode or margin of a module."""
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
    """An upper bound of a module's margin, in s."""
    return max(of.levels - 1, 1) * of.period_ns / 1e9


def _margin_assumption(of: Module) -> str:
    return f"margin({of.name}): 0 to {_longest_s(of):g} s, anew at every read"


def in_ac(e: typed.TypedExpr, modes: Modes) -> typed.TypedExpr:
    """The expression with all modes of other modules replaced by AC."""

    def instead(part: typed.TypedExpr) -> typed.TypedExpr:
        if isinstance(part, typed.TopicRead) and part.topic in modes.topics:
            return typed.Literal(MODE, part.span, AC)
        return part

    expression: typed.TypedExpr = rewritten(e, instead)
    return expression


# ---------------------------------------------------------------- who waits for whom


def _modules_by_read(flat: System, module: Module, sc: Component) -> dict[Read, Module]:
    own = {**sc.scope.modules, **module.scope.modules}
    return {
        (kind, s): flat.modules[own[s]]
        for kind, s in _other_modules_read(module, sc)
        if s in own and (kind == "margin" or own[s] != module.index)
    }


def _modules_by_topic(
    kind: str, of: Mapping[typed.TopicSymbol, tuple[str, Module]]
) -> dict[typed.TopicSymbol, Module]:
    return {t: m for t, (read, m) in of.items() if read == kind}


def _other_modules_read(module: Module, sc: Component) -> list[Read]:
    symbol, node = module.symbol, sc.node
    assert node is not None
    code = () if node.extern else (*node.step, *(node.takeover or ()))
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    reads: dict[Read, None] = {}
    for n in nodes((*code, *predicates)):
        if isinstance(n, (typed.ModeRead, typed.MarginRead)):
            reads[READS[type(n)], n.module] = None
    return list(reads)


def _modes_read_in(module: Module, *predicates: str) -> list[int]:
    """The other modules whose modes these predicates of a module read."""
    symbol = module.symbol if module.whole is None else module.whole
    said = [e for e in (getattr(symbol, p) for p in predicates) if e is not None]
    read = [n.module for n in nodes(said) if isinstance(n, typed.ModeRead)]
    indices = [module.scope.modules.get(s, module.index) for s in read]
    return [i for i in dict.fromkeys(indices) if i != module.index]


def _why_never_in_ac(flat: System, module: Module, waits: list[int]) -> str:
    """Why the modules that a module waits for may never be in AC together, in words; else "".

    One is forced to SC; or the decision of one depends, through any modes, on this module, which is
    in SC while it waits.
    """
    for i in waits:
        there = flat.modules[i]
        if there.forced == "sc":
            return f"{there.name} is forced to SC"
        seen, todo = {i}, [i]
        while todo:
            here = flat.modules[todo.pop()]
            for k in _modes_read_in(here, "ttf", "safer"):
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
    """A cached symbol, as symbols are compared by identity: the same for the same module."""
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


def _scope_with_topics(scope: Scope, topics: Mapping[typed.TopicSymbol, int]) -> Scope:
    return replace(scope, topics={**scope.topics, **topics})


DECLARED = {"late_dm", "response_dm", "nodes"}
"""The times of the module above that a hand-back depends on."""


@dataclass(frozen=True)
class Above:
    """The module above; `safer`: the parts of its `safer` that the plants of the proof show.

    `back_ns`: the longest time in ns from the state behind a verdict that gives control back until
    that is in force; `declared`: whether all times in it are declared.
    """

    name: str
    safer: typed.TypedExpr
    back_ns: int
    declared: bool

    @property
    def assumptions(self) -> list[Assumption]:
        """The assumptions about when the claim holds, and about the module above."""
        while_ = (
            f"`safe` is claimed while {self.name} is in AC, from each time on at which it gives "
            "control back; not before the first, and not while it is in SC"
        )
        counted = (
            f"a verdict of {self.name} by which it gives control back is in force at most "
            f"{show_ns(self.back_ns)} after the state that it is about"
        )
        stops = (
            f"while {self.name} is in SC, too, what plants publish lies in the declared sets (else "
            "they stop)"
        )
        return [
            Assumption(f"while {self.name}", while_),
            Assumption(f"verdict of {self.name}", counted),
            Assumption(f"sets while {self.name}", stops),
        ]


def with_module_above(
    flat: System, at: VerificationSystem, kind: ProblemKind, diagnostics: Diagnostics
) -> tuple[VerificationSystem, Above | None]:
    """The verification system with hand-backs of the module above as `enters`, and that module.

    None where there is none above, or, with a diagnostic R020, where no proof covers it.
    """
    modules = modules_above(flat, at.home.index)
    if not modules:
        return at, None
    above = _module_above(flat, at, modules[0], kind, diagnostics)
    if above is None:
        return at, None
    symbol = at.module.symbol
    verify = replace(symbol.verify, enters=above.safer)
    module = replace(at.module, symbol=replace(symbol, verify=verify))
    return replace(at, system=with_module(at.system, module), module=module), above


def handed_back(times: Times, above: Above | None) -> Times:
    """The times with the H that a hand-back needs, and with the times that it depends on."""
    if above is None:
        return times
    return replace(
        times,
        schedule=replace(times.schedule, back=above.back_ns),
        declared=times.declared if above.declared else times.declared - {"nodes"},
    )


def _module_above(
    flat: System,
    at: VerificationSystem,
    module: Module,
    kind: ProblemKind,
    diagnostics: Diagnostics,
) -> Above | None:
    params = [{p: repr(v) for p, v in m.scope.params.items()} for m in (module, at.module)]
    parts = [e for e in conjuncts(_safer_with_modes(module)) if _same_for_plants(e, module, at)]
    wrong = {
        "its plants move in steps (`next`): two DMs and two SCs share an instant": kind != "flow",
        f"`{module.name}` has other values of its parameters": params[0] != params[1],
        f"`safer` of `{module.name}` says nothing of its plants": not parts,
    }
    why = next((why for why, is_so in wrong.items() if is_so), "")
    if why:
        _refuse(at, module, why, diagnostics)
        return None
    times = _times_of_views(flat, module, diagnostics)
    if not times:
        return None
    return Above(
        module.name,
        reduce(lambda a, b: typed.TypedBinary(a.type, a.span, "&&", a, b), parts),
        max(t.age_dm + t.late_dm + t.response_dm for t in times),
        all(t.declared >= DECLARED for t in times),
    )


def _safer_with_modes(module: Module) -> typed.TypedExpr:
    symbol = module.whole or module.symbol
    assert symbol.safer is not None, "M019"
    return symbol.safer


def _same_for_plants(part: typed.TypedExpr, module: Module, at: VerificationSystem) -> bool:
    """Whether a part of the `safer` above means the same of the proof's plants.

    It does if it reads only topics that DM or SC below also read, as their errors are known.
    """
    known = {*read_by_dm(at), *read_by_sc(at)}
    if any(type(n) in UNKNOWN_FACTS for n in nodes([part])):
        return False
    for topic in topic_reads(part):
        own_topic = module.scope.topics[topic]
        if at.flying(topic) != own_topic or at.module.scope.topics.get(topic) not in known:
            return False
    return bool(topic_reads(part))


def _times_of_views(flat: System, module: Module, diagnostics: Diagnostics) -> list[Times]:
    """The times of the module above in each of its views; empty, with diagnostics, if none."""
    times = []
    for seen in systems_by_view(flat, module):
        system, one, _ = modes_as_topics(*seen)
        there = place(system, one)
        times.append(times_of(there, "flow", diagnostics)[0])
    return [] if diagnostics.has_errors else times


def _refuse(at: VerificationSystem, module: Module, why: str, diagnostics: Diagnostics) -> None:
    diagnostics.error(
        "R020",
        f"module `{at.home.name}` stands below module `{module.name}`, and is not proved there",
        at.home.symbol.span,
        also=((module.symbol.span, f"`{module.symbol.name}`"),),
        notes=(why,),
        helps=(
            f"let `safer` of `{module.symbol.name}` say where it gives control back",
            "or leave `verify` out: then nothing is claimed of it",
        ),
    )
