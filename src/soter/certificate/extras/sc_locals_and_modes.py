"""Reads an SC with locals, with modes of others, or that steps before states are published.

Purpose: `published_in_every_step` reads every step that SC may take, one combination of modes and
values of its locals after the other; `any_alternative` makes a term for whatever one of several
steps publishes. `check_start_answers` shows that SC's first steps publish values in their sets and
cannot fault: on defaults, or, where not all that SC reads is published at once, on any values. Who
decides the modes of other modules is no part of a certificate: a step of SC is read once for each
combination of them, a predicate with each of them open.
Non-goals: which of these values occur after which: any element of the set that every step keeps may
be there at any step (docs/proof.md, "Setting"); that a step keeps it is an obligation of the step.
What a module waits for (P2b is not claimed of one that waits); sharing code with
`verify/problem/verification_system.py`, which reads topics in their place.

Truths, enumerations and short ranges are taken value by value; what would make too many
combinations becomes an input over its range, as a float does over the range that is claimed of it.
"""

from __future__ import annotations

from itertools import product, repeat
from math import prod
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.case_model import command_term, sc_step_reader
from soter.certificate.reading.module_facts import topics_read_by_sc
from soter.certificate.reading.symbolic_values import symbolic_int, value_of_leaves
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, ball_key, exact
from soter.certificate.terms.terms import Atom, Terms
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.reading.symbolic_reading import Ranges
    from soter.certificate.report import Said
    from soter.certificate.terms.compile_terms import AffineForms, Ends, Row
    from soter.certificate.terms.terms import Linear, Proposition
    from soter.language.model.system import Topic
    from soter.language.model.types import Type

    Key = typed.ModuleSymbol | str


MODES_MAX = 4
"""SC may look at so many modules' modes: its step is read for every combination."""
COMBINATIONS_MAX = 256
WIDEST = 2**31
"""Longer ranges than this are no bounded ints for us."""


def modes_in(code: Sequence[object]) -> list[Key]:
    """The modules whose mode a piece of code reads."""
    modules = [
        n.module for n in nodes([x for x in code if x is not None]) if isinstance(n, typed.ModeRead)
    ]
    return list(dict.fromkeys(modules))


def mode_combinations(code: Sequence[object]) -> Iterator[dict[Key, int]]:
    """Yields every combination of the modes that a step reads; an empty one if it reads no mode.

    Raises NotRecheckedError if the combinations are too many.
    """
    keys = modes_in(code)
    if len(keys) > MODES_MAX:
        raise NotRecheckedError(f"SC looks at the modes of more than {MODES_MAX} modules")
    for values in product((0, 1), repeat=len(keys)):
        yield dict(zip(keys, values, strict=True))


def mode_inputs(terms: Terms, code: Sequence[object]) -> dict[Key, Any]:
    """A new input, 0 or 1, for every mode that the code reads."""
    return {key: symbolic_int(terms.add_input("box", "mode", ZERO, ONE)) for key in modes_in(code)}


def require_modes_of_others(facts: Facts) -> None:
    """Raises NotRecheckedError for the module's mode, an unknown mode, or a mode in `safe`.

    The check uses the flying module, as a view or an abstraction has other symbols.
    """
    flying, module = facts.flying, facts.flying_module
    sc = flying.components[module.sc]
    assert sc.node is not None
    symbol = facts.symbol
    other = [e for e in symbol.predicates if e is not symbol.ttf and e is not symbol.safer]
    if modes_in(other):
        raise NotRecheckedError("`mode` in another predicate than `ttf` and `safer`")
    asked = [(sc.scope, key) for key in modes_in(sc.node.step)]
    asked += [(module.scope, key) for key in modes_in([symbol.ttf, symbol.safer])]
    for scope, key in asked:
        if scope.modules.get(key, module.index) == module.index:
            raise NotRecheckedError("the module's own mode, or that of an unknown one")


def mode_assumptions(facts: Facts) -> Said:
    """The assumptions on modules whose modes SC, `ttf` or `safer` read, and on P2b for `safer`."""
    flying, module = facts.flying, facts.flying_module
    sc = flying.components[module.sc]
    assert sc.node is not None
    waited = {module.scope.modules[k] for k in modes_in([facts.symbol.safer])}
    read = {sc.scope.modules[k] for k in modes_in(sc.node.step)}
    read |= {module.scope.modules[k] for k in modes_in([facts.symbol.ttf])}
    for name in (flying.modules[i].name for i in sorted(read | waited)):
        yield f"mode {name}", f"mode({name}): SC or AC, anew at every step that reads it"
    for name in (flying.modules[i].name for i in sorted(waited)):
        text = f"nothing is confirmed of P2b: `safer` waits until {name} is in AC"
        yield f"waits {name}", text


def published_in_every_step(
    terms: Terms,
    sc: typed.NodeSymbol,
    with_modes: Callable[[Any], Callable[[Any], dict[int, Any]]],
    claimed: Ranges,
) -> Iterator[dict[int, Any]]:
    """Yields what SC may publish: `with_modes(modes)(locals)` for every combination of both."""
    for modes in mode_combinations(sc.step):
        published = with_modes(modes)
        for known_locals in combinations_of_locals(terms, sc.locals, claimed):
            yield published(known_locals)


def combinations_of_locals(
    terms: Terms, variables: Sequence[typed.Variable], claimed: Ranges
) -> Iterator[dict[typed.Variable, Any]]:
    """Every combination of values of locals, or an empty one; `claimed`: ranges of floats."""
    parts: list[Any] = [
        ends or of
        for v in variables
        for ends, (_, of) in zip(claimed.get(v, repeat(None)), _local_leaves(v), strict=False)
    ]
    sizes = [_number_of_values(of) for of in parts]
    by_size = sorted(range(len(parts)), key=lambda k: sizes[k])
    single: set[int] = set()
    for k in by_size:
        if prod(sizes[i] for i in (*single, k)) <= COMBINATIONS_MAX:
            single.add(k)
    ranges: list[list[Any]] = []
    for k, of in enumerate(parts):
        ranges.append(_all_values_of_type(of) if k in single else [_new_input_of_type(terms, of)])
    for values in product(*ranges):
        left = list(values)
        value_by_variable = {}
        for v in variables:
            count = len(_local_leaves(v))
            value_by_variable[v] = value_of_leaves(v.type, left[:count])
            left = left[count:]
        yield value_by_variable


def _local_leaves(variable: typed.Variable) -> list[tuple[tuple[str, ...], Type]]:
    variable_leaves = list(leaves(variable.type))
    if any("[]" in path for path, _ in variable_leaves):
        raise NotRecheckedError(f"a list in the local `{variable.name}` is not rechecked")
    return variable_leaves


def _number_of_values(of: Type | tuple[float, float]) -> int:
    if isinstance(of, tuple):
        return COMBINATIONS_MAX + 1
    if isinstance(of, BoolType):
        return 2
    if isinstance(of, EnumType):
        return len(of.members)
    if isinstance(of, IntType) and of.high - of.low < WIDEST:
        return of.high - of.low + 1
    raise NotRecheckedError("an SC with a local that is no truth, enumeration or bounded int")


def _all_values_of_type(of: Type) -> list[Any]:
    if isinstance(of, BoolType):
        return [False, True]
    if isinstance(of, IntType):
        return list(range(of.low, of.high + 1))
    return list(range(_number_of_values(of)))


def _new_input_of_type(terms: Terms, of: Type | tuple[float, float]) -> Linear | Proposition:
    if isinstance(of, tuple):
        return terms.add_input("box", "local", *map(exact, of))
    if isinstance(of, BoolType):
        free = terms.add_input("box", "local", exact(0.0), exact(1.0))
        return terms.below_zero(terms.combine(((ONE, free),), exact(-0.5)))
    low, high = (of.low, of.high) if isinstance(of, IntType) else (0, _number_of_values(of) - 1)
    return symbolic_int(terms.add_input("box", "local", exact(float(low)), exact(float(high))))


# ---------------------------------------------------------------- one of several


def any_alternative(terms: Terms, alternatives: Sequence[Linear]) -> Linear:
    """A term that stands for any alternative; alternatives with equal enclosures count once."""
    shapes = _Shapes(terms)
    kept: dict[object, Linear] = {}
    for x in alternatives:
        kept.setdefault(shapes.key(x), x)
    different = list(kept.values())
    first = different[0]
    if len(different) == 1:
        return first
    low, high = first.low, first.high
    for x in different[1:]:
        low, high = low.min(x.low), high.max(x.high)
    gaps = [terms.subtract(x, first) for x in different[1:]]
    return terms.add_atom(Atom("any", (*different, *gaps), low=low, high=high))


def enclose_any(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of any alternative: the first row, widened until it contains all."""
    count, ranges = (len(atom.arguments) + 1) // 2, [*map(forms.term_ends, atom.arguments)]
    row, constant, spread = forms.row_of(atom.arguments[0])
    low, high = _ends_around_intervals(forms, [(forms.make.zero,) * 2, *ranges[count:]])
    line = row, constant + (low + high) * HALF, spread + (high - low) * HALF
    return line, _ends_around_intervals(forms, ranges[:count])


def _ends_around_intervals(forms: AffineForms, intervals: Sequence[Ends]) -> Ends:
    (low, high), *others = intervals
    for least, most in others:
        low, high = forms.make.apply("min", low, least), forms.make.apply("max", high, most)
    return low, high


class _Shapes:
    """Keys that are equal for terms of equal structure over the same inputs.

    Two such terms may have different values, but their enclosures are equal, so either serves both.
    """

    def __init__(self, terms: Terms) -> None:
        self._terms = terms
        self._atoms: dict[int, int] = {}
        self._truths: dict[Proposition, int] = {}
        self._names: dict[object, int] = {}

    def key(self, x: Linear) -> object:
        """The key of a term."""
        parts = frozenset((self._atom_key(a), ball_key(c)) for a, c in x.terms.items())
        rounded = x.rounds and self.key(x.rounds)
        return (ball_key(x.const), ball_key(x.radius), parts, x.nonnegative, rounded)

    def _atom_key(self, index: int) -> int:
        """The number of an atom's shape; equal shapes have equal numbers."""
        if index not in self._atoms:
            atom = self._terms.atoms[index]
            shape: object = index
            if atom.kind not in ("state", "box"):
                shape = (
                    atom.kind,
                    tuple(self.key(x) for x in atom.arguments),
                    None if atom.condition is None else self._truth_key(atom.condition),
                    tuple(ball_key(w) for w in atom.weights),
                    atom.values,
                    atom.shape,
                    ball_key(atom.extra),
                    ball_key(atom.share),
                )
            self._atoms[index] = self._names.setdefault(shape, len(self._names))
        return self._atoms[index]

    def _truth_key(self, x: Proposition) -> int:
        if x not in self._truths:
            argument, parts = (x.argument and self.key(x.argument), map(self._truth_key, x.parts))
            shape = (x.kind, tuple(parts), argument, x.value, x.strict)
            self._truths[x] = self._names.setdefault(shape, len(self._names))
        return self._truths[x]


# ---------------------------------------------------------------- before anything was published


def check_start_answers(facts: Facts) -> None:
    """Raises NotRecheckedError unless SC surely answers all that it may read before states exist.

    While no topic shows a state, SC reads only defaults, if one publisher writes all topics each
    time and waits until it has read a state. Otherwise SC may read a state of one topic with the
    default of another, so each may be any value of its set.
    """
    setting = facts.setting
    sc = facts.sc
    assert sc.node is not None
    if sc.node.locals:
        raise NotRecheckedError("an SC with locals that may step before anything was published")
    paths = {r.name: r.paths for r in setting.by_sc}
    every = [p for of in paths.values() for p in of]
    at_once = len({p.clocks[-1].name for p in every}) == 1
    at_once = at_once and not any(p.may_publish_nothing(setting.silent) for p in every)
    terms, known = Terms(), {}
    for symbol in topics_read_by_sc(sc):
        topic = facts.system.topics[sc.scope.topics[symbol]]
        running = facts.flying.topics[facts.running[topic.index]].name
        only_default = at_once and running in paths
        known[symbol] = _any_topic_value(terms, topic, default=only_default)
    if not is_step_harmless(facts, terms, known):
        raise NotRecheckedError(
            "SC may step before anything was published, and fault on what it then reads"
        )


def is_step_harmless(facts: Facts, terms: Terms, known: dict[typed.TopicSymbol, Any]) -> bool:
    """Whether a step of SC on these values surely publishes all outputs, within their sets."""
    sc = facts.sc
    assert sc.node is not None
    published = sc_step_reader(terms, sc, known, mode_inputs(terms, sc.node.step))({})
    for control in facts.controls:
        command_term(terms, control, [published])
    return all_certain(terms, terms.obligations)


def _any_topic_value(terms: Terms, topic: Topic, *, default: bool) -> Any:  # noqa: ANN401  a Soter value
    """A term for any value in the set of a topic; with `default`, for the default alone."""
    bounded = all(
        b is not None and isinstance(of, FloatType)
        for (_, of), b in zip(leaves(topic.type), topic.bounds, strict=True)
    )
    if default or not bounded:
        if not default:
            early = "what was published before all that it reads shows a state"
            raise NotRecheckedError(f"SC may read of `{topic.name}` {early}, and it has no set")
        return topic.default
    parts = [
        terms.add_input("box", topic.name, exact(b.low), exact(b.high))
        for b in topic.bounds
        if b is not None
    ]
    return value_of_leaves(topic.type, parts)
