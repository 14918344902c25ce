"""Warns of a module whose predicates, as written, contradict each other.

Purpose: warns W013, with allowed values of topics at which `ttf` and `safer` both hold, or which
show that the two are exchanged or that one is negated. It tries a few hundred values, most of them
numbers in the predicates and between these.
Non-goals: a proof that there is no such state (`soter verify`: P3); predicates that read ages,
times or modes; states that the plant never reaches.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

from soter.diagnostics.fixes import exchange, replace
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import (
    are_same_expression,
    children,
    conjuncts,
    disjuncts,
    nodes,
    topic_reads,
)
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    leaf_count,
    leaf_name,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Module, System, Topic
    from soter.language.model.types import Type, Value

TRIED = 300
LEAVES_MAX = 24
NUMBERS_MAX = 12
LOST_MIN = 20
"""The least number of tried values that violate `safe` before a warning speaks of all of them."""
TURNED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}
ROLES = "`ttf` says when AC must not go on, `safer` when it may have control again"
BUDGET = 400_000
"""Most operations for all values of one module: about a tenth of a second."""

Trial = tuple[bool, bool, bool, list["Value"]]
"""The truth of `ttf`, `safer` and `safe`, and the values of the topics that gave it."""


def cached_trials(system: System, module: Module) -> list[Trial]:
    """Gives the trials of a module; [] if its predicates are computed or cannot be evaluated."""
    symbol = module.symbol
    if symbol.ttf is None or symbol.safer is None:
        return []
    predicates = (symbol.ttf, symbol.safer, symbol.safe)
    if not read_nothing_but_topics(predicates):
        return []
    indices = indices_of_tried_topics(module)
    if sum(leaf_count(system.topics[i].type) for i in indices) > LEAVES_MAX:
        return []
    known = system.program.trials
    key = _key_of_trials(system, module, indices)
    if key not in known:
        known[key] = trials_of_predicates(system, module, predicates, indices)
    return cast("list[Trial]", known[key])


def _key_of_trials(system: System, module: Module, indices: Sequence[int]) -> tuple[object, ...]:
    """Gives a key made of all that a module's trials depend on; systems of one key share them."""
    place = {index: k for k, index in enumerate(indices)}
    wires = ((t, place.get(i)) for t, i in module.scope.topics.items() if i in place)
    of_topics = ((t.type, t.bounds, t.default) for t in (system.topics[i] for i in indices))
    return (module.symbol, *module.scope.params.items(), *wires, *of_topics)


def warn_of_contradictions(
    system: System, module: Module, trials: Sequence[Trial], diagnostics: Diagnostics
) -> bool:
    """Warns W013 if `ttf` and `safer` contradict each other; returns whether it warned."""
    symbol = module.symbol
    ttf, safer = symbol.ttf, symbol.safer
    if ttf is None or safer is None or not trials:
        return False
    if _are_exchanged(trials):
        diagnostics.warning(
            "W013",
            f"`ttf` and `safer` of module `{symbol.name}` look exchanged",
            ttf.span,
            "false wherever `safe` is lost",
            also=((safer.span, "true wherever `safe` is lost"), (symbol.safe.span, "`safe`")),
            notes=(ROLES,),
            helps=(exchange(ttf.span, safer.span, "exchange the two conditions"),),
        )
        return True
    overlaps = [t for t in trials if t[0] and t[1]]
    if overlaps and _warn_of_negated_predicate(symbol, trials, diagnostics):
        return True
    if overlaps and (_share_a_comparison(ttf, safer) or are_same_expression(safer, symbol.safe)):
        where = text_of_values(system, indices_of_tried_topics(module), overlaps[0][3])
        diagnostics.warning(
            "W013",
            f"`ttf` and `safer` of module `{symbol.name}` can both hold",
            safer.span,
            f"also where {where}",
            also=((ttf.span, "`ttf`, which holds there, too"),),
            notes=("control would go back to AC and be taken away at the next look",),
            helps=("leave a gap: let `safer` begin where `ttf` has long ended",),
        )
        return True
    return False


def _are_exchanged(trials: Sequence[Trial]) -> bool:
    """Whether `ttf` and `safer` seem exchanged, both where `safe` holds and where it is lost."""
    lost = [t for t in trials if not t[2]]
    turned = bool(lost) and all(s and not f for f, s, _, _ in lost)
    return turned and any(f and not s for f, s, held, _ in trials if held)


def _negated_predicate(trials: Sequence[Trial]) -> tuple[str, bool] | None:
    """Gives the predicate that is negated by mistake, and whether its opposite fits; or None."""
    lost = [t for t in trials if not t[2]]
    if len(lost) < LOST_MIN:
        return None
    if not any(f or s for f, s, _, _ in lost):
        return "ttf", all(f or not s for f, s, _, _ in trials)
    if all(f and s for f, s, _, _ in lost):
        return "safer", all(s or not f for f, s, _, _ in trials)
    return None


def _warn_of_negated_predicate(
    symbol: typed.ModuleSymbol, trials: Sequence[Trial], diagnostics: Diagnostics
) -> bool:
    """Warns W013 of a predicate negated by mistake: `ttf` is false, or `safer` true, in danger."""
    turned = _negated_predicate(trials)
    if turned is None:
        return False
    name, gap = turned
    predicate = symbol.ttf if name == "ttf" else symbol.safer
    assert predicate is not None
    other = negated_text(predicate)
    turn = replace(predicate.span, other, f"the other way round: `{name} {other};`")
    diagnostics.warning(
        "W013",
        f"`{name}` of module `{symbol.name}` looks turned round",
        predicate.span,
        f"{'false' if name == 'ttf' else 'true'} wherever `safe` is lost",
        also=((symbol.safe.span, "`safe`"),),
        notes=(ROLES,),
        helps=(turn if gap else "turn its comparison round",),
    )
    return True


def negated_text(e: typed.TypedExpr) -> str:
    """Gives the source text of the negation of `e`."""
    if isinstance(e, typed.TypedUnary) and e.op == "!":
        return e.operand.span.text
    if isinstance(e, typed.TypedBinary) and e.op in TURNED:
        return f"{e.left.span.text} {TURNED[e.op]} {e.right.span.text}"
    return f"!({e.span.text})"


def indices_of_tried_topics(module: Module) -> list[int]:
    """Gives the indices of topics that get tried values, in the order of a trial's values."""
    symbol, topics = module.symbol, module.scope.topics
    written = [e for e in (symbol.ttf, symbol.safer, symbol.safe) if e is not None]
    return sorted({topics[t] for t in topic_reads(*written) if t in topics})


def read_nothing_but_topics(predicates: Sequence[typed.TypedExpr]) -> bool:
    """Whether predicates read only values of topics: no ages, times, modes, externs or choices."""
    late = (typed.AgeRead, typed.TimeRead, typed.ModeRead, typed.MarginRead, typed.TypedChoose)
    return not any(
        isinstance(n, late) or (isinstance(n, typed.TypedCall) and n.fun.extern)
        for n in _all_nodes(predicates)
    )


def _share_a_comparison(ttf: typed.TypedExpr, safer: typed.TypedExpr) -> bool:
    """Whether both compare the same expression with constants, which must then leave a gap."""
    parts = {_text_without_constants(p) for p in disjuncts(ttf)}
    return any(_text_without_constants(p) in parts for p in conjuncts(safer))


def _text_without_constants(node: object) -> str:
    """Gives an expression as text, with `#` for constants and `?` for <, <=, > and >=."""
    if isinstance(node, (typed.Literal, typed.ParamRead)):
        return "#"
    inner = [_text_without_constants(child) for child in children(node)]
    if inner and all(i == "#" for i in inner):
        return "#"
    name = type(node).__name__
    if isinstance(node, typed.TopicRead):
        name = node.topic.name
    elif isinstance(node, typed.VarRead):
        name = node.variable.name
    elif isinstance(node, typed.TypedCall):
        name = node.fun.name
    elif isinstance(node, typed.TypedField):
        name = f"field {node.index}"
    elif isinstance(node, typed.TypedBinary):
        name = "?" if node.op in ("<", "<=", ">", ">=") else node.op
    return f"{name}({', '.join(inner)})"


def _all_nodes(predicates: Sequence[typed.TypedExpr]) -> list[object]:
    """Gives all nodes of the predicates and of the functions that they call."""
    all_nodes: list[object] = []
    seen: set[typed.FunSymbol] = set()
    todo: list[object] = list(predicates)
    while todo:
        for node in nodes([todo.pop()]):
            all_nodes.append(node)
            if isinstance(node, typed.TypedCall) and node.fun not in seen:
                seen.add(node.fun)
                todo += list(node.fun.body or ())
    return all_nodes


def trials_of_predicates(
    system: System, module: Module, predicates: Sequence[typed.TypedExpr], indices: list[int]
) -> list[Trial]:
    """Gives (ttf, safer, safe, values) for many values of the topics; omits faulting ones."""
    numbers = numbers_to_try(predicates)
    draw = random.Random(0)  # noqa: S311 - values to try, always the same
    settings: dict[str, Any] = {"budget": BUDGET, "topics": module.scope.topics}
    plain = Evaluator(module.scope.params, **settings)
    deciding = PredicateEvaluator(module.scope.params, **settings)
    values = [t.default for t in system.topics]
    trials: list[Trial] = []
    left = BUDGET
    drawn = {i: _value_drawer(system.topics[i], numbers, draw) for i in indices}
    for _ in range(TRIED):
        for i, value in drawn.items():
            values[i] = value()
        env = Environment(topics=values, stamps=[0] * len(values))
        try:
            held = []
            for p in predicates:
                decides = p is module.symbol.ttf or p is module.symbol.safer
                evaluator = deciding if decides else plain
                held.append(bool(evaluator.value(p, env)))
                left -= evaluator.operations_spent
        except StepFault:
            continue
        except BudgetExceeded:
            break
        if left < 0:
            break
        trials.append((held[0], held[1], held[2], [values[i] for i in indices]))
    return trials


def numbers_to_try(predicates: Sequence[typed.TypedExpr]) -> list[float]:
    """Gives the numbers in the predicates, the middles between neighbours, and their negatives."""
    literals = [n.value for n in _all_nodes(predicates) if isinstance(n, typed.Literal)]
    constants = {float(v) for v in literals if isinstance(v, (int, float)) and abs(v) < 1e12}
    signed = sorted({s * v for v in constants for s in (1.0, -1.0)})[: 2 * NUMBERS_MAX]
    return [*signed, *((a + b) / 2 for a, b in pairwise(signed))] or [0.0]


def _value_drawer(topic: Topic, numbers: list[float], draw: random.Random) -> Callable[[], Value]:
    """Gives a function that draws values of a topic, half from `numbers`, half uniformly."""
    if not _is_without_lists(topic.type):
        return lambda: topic.default
    far = 2.0 * max(10.0, *(abs(n) for n in numbers))
    bounds = iter(topic.bounds)

    def scalar_drawer(t: Type) -> Callable[[], Value]:
        bound = next(bounds)
        low, high = (-far, far) if bound is None else (bound.low, bound.high)
        near = [n for n in numbers if low <= n <= high]

        def drawn_number() -> float:
            return draw.choice(near) if near and draw.random() < 0.5 else draw.uniform(low, high)

        if isinstance(t, BoolType):
            return lambda: draw.random() < 0.5
        if isinstance(t, EnumType):
            return lambda: draw.randrange(len(t.members))
        if isinstance(t, IntType):
            return lambda: min(max(round(drawn_number()), t.low), t.high)
        return drawn_number

    def drawer(t: Type) -> Callable[[], Value]:
        if isinstance(t, RecordType):
            parts = [drawer(f) for _, f in t.fields]
        elif isinstance(t, ArrayType):
            parts = [drawer(t.element) for _ in range(t.size)]
        elif isinstance(t, (BoolType, EnumType, FloatType, IntType)):
            return scalar_drawer(t)
        else:
            return lambda: topic.default
        return lambda: tuple(part() for part in parts)

    return drawer(topic.type)


def _is_without_lists(t: Type) -> bool:
    """Whether `t` contains no list, so that every leaf has its own bound."""
    return all("[]" not in path for path, _ in leaves(t))


def text_of_values(system: System, indices: Sequence[int], values: Sequence[Value]) -> str:
    """Gives a text of the first three numbers, such as "`m.x` is 9.0 and `m.v` is 0.5"."""
    parts: list[str] = []
    for index, value in zip(indices, values, strict=True):
        topic = system.topics[index]
        if not _is_without_lists(topic.type):  # elements of lists have no names
            parts.append(f"`{topic.name}` has its first value")
            continue
        for (path, t), leaf in zip(leaves(topic.type), scalars_in(value), strict=False):
            name = leaf_name(topic.name, path)
            shown = f"{t.name}.{t.members[cast('int', leaf)]}" if isinstance(t, EnumType) else ""
            if isinstance(leaf, bool):
                shown = str(leaf).lower()
            parts.append(f"`{name}` is {shown or f'{leaf:.4g}'}")
    return " and ".join(parts[:3])


def scalars_in(value: Value) -> list[Value]:
    """Gives the scalars in a value, in order."""
    return [x for v in value for x in scalars_in(v)] if isinstance(value, tuple) else [value]


def with_scalars(values: Sequence[Value], scalars: Sequence[Value]) -> list[Value]:
    """Gives `values` with their scalars replaced by `scalars`, in the order of `scalars_in`."""
    new_scalars = iter(scalars)

    def refilled(value: Value) -> Value:
        return tuple(refilled(v) for v in value) if isinstance(value, tuple) else next(new_scalars)

    return [refilled(v) for v in values]


Holds = Callable[["Sequence[typed.TypedExpr]", "Sequence[Value]"], list[bool]]
"""(predicates, values of topics) -> whether each predicate holds; one that faults does not."""


def evaluator_of_predicates(system: System, module: Module, indices: Sequence[int]) -> Holds:
    """Gives a function that evaluates predicates at values of topics; it raises BudgetExceeded."""
    evaluator = Evaluator(module.scope.params, budget=BUDGET, topics=module.scope.topics)
    topics = [t.default for t in system.topics]
    left = BUDGET

    def holds(predicates: Sequence[typed.TypedExpr], values: Sequence[Value]) -> list[bool]:
        nonlocal left
        for i, value in zip(indices, values, strict=True):
            topics[i] = value
        env, held = Environment(topics=topics, stamps=[0] * len(topics)), []
        for p in predicates:
            try:
                held.append(bool(evaluator.value(p, env)))
            except StepFault:
                held.append(False)
            left -= evaluator.operations_spent
        if left < 0:
            raise BudgetExceeded
        return held

    return holds
