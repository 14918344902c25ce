"""Checks that a proof can follow a program's constructs, before anything is computed.

Purpose: `check_supported` reports controllers, plants and predicates that `verify/` cannot handle.
`ttf_of_states` drops the parts of `ttf` that read an age. `topics_of_maps`, `check_maps` and
`map_assumptions` are about maps: `static` topics that no plant drives and that `safe` of a module
with `rest` reads; their contract is an assumption (docs/proof-flight.md, "Decisions by tubes", 7).
`identified_assumptions` is about numbers that were fitted to logs.
Non-goals: numbers; what the DM does, which is compiled and compared with all of `ttf`; the check
that reads maps (`verify/tubes/`).

`ttf e || age(t) > c` is true wherever e is, so "not ttf" implies "not e". A claim that is proved
with e in the place of `ttf` therefore holds with all of `ttf`, too.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.assumption_words import in_words
from soter.language.model.tree_walk import calls_in, disjuncts, nodes, plant_code, topic_reads
from soter.language.model.types import BOOL, BoolType, EnumType, FloatType, IntType, leaves
from soter.verify.problem.problem import Assumption

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type
    from soter.verify.problem.problem import ProblemKind
    from soter.verify.problem.verification_system import VerificationSystem


def topics_of_maps(system: System, module: Module) -> dict[typed.TopicSymbol, int]:
    """The map topics that `safe` reads, in order, with their indices; none without `rest`."""
    if module.symbol.rest is None:
        return {}
    at = module.scope.topics
    other = _driven_topics(system).union(module.outputs)
    read = topic_reads(module.symbol.safe)
    return {t: at[t] for t in read if t.static and at[t] not in other}


def topics_of_proved_maps(place: VerificationSystem) -> dict[typed.TopicSymbol, int]:
    """The maps of a verification system, without topics of plants that only fly."""
    flying = _driven_topics(place.flat)
    found = topics_of_maps(place.system, place.module)
    return {t: index for t, index in found.items() if place.flying_index(t) not in flying}


def _driven_topics(system: System) -> set[int]:
    """The topics that the plants of a system drive."""
    plants = [(c, c.plant) for c in system.components if c.plant is not None]
    return {c.scope.topics[t] for c, plant in plants for t, _ in plant.drives}


def check_maps(place: VerificationSystem, diagnostics: Diagnostics) -> None:
    """Reports R007, R011 or R014 for topics that are read as maps but cannot be maps."""
    rest, node = place.module.symbol.rest, place.flat.components[place.home.sc].node
    by_sc = {} if node is None else topic_reads(*node.step)
    at_rest = {} if rest is None else topic_reads(rest.condition)
    for symbol, index in topics_of_proved_maps(place).items():
        topic = place.system.topics[index]
        for who, reads in (("SC", by_sc), ("`rest`", at_rest)):
            if symbol in reads:
                diagnostics.error(
                    "R007",
                    f"{who} reads `{topic.name}`, a map of `safe`",
                    reads[symbol].span,
                    also=((symbol.span, "declared here"),),
                    notes=("a verdict is about one map, and SC would read later ones",),
                    helps=("leave it to `safe` and AC",),
                )
        if topic.max_age_ns is None:
            diagnostics.error(
                "R011",
                f"nothing bounds the age of the map `{topic.name}`",
                symbol.span,
                notes=("until it is published, and when it is no more, AC must not have control",),
                helps=("declare it: `topic ... max_age 1s;`",),
            )
        parts = leaves(topic.type)
        floats = all("[]" not in path and isinstance(of, FloatType) for path, of in parts)
        if topic.queue_of is not None or not floats:
            diagnostics.error(
                "R014",
                f"the map `{topic.name}` is not made of floats",
                symbol.span,
                f"its type is `{topic.type}`",
                notes=("a check takes as many numbers each time",),
                helps=("an array of as many as are looked at; what it leaves out is occupied",),
            )


def map_assumptions(place: VerificationSystem) -> list[Assumption]:
    """The assumption for each map that a place that is free in the map stays free."""
    names = [place.system.topics[index].name for index in topics_of_proved_maps(place).values()]
    return [
        Assumption(
            f"map {name}",
            f"where `safe` holds with a value of {name}, with its default at the start, it is safe "
            "for ever: what it calls free stays free",
        )
        for name in names
    ]


def identified_assumptions(program: typed.TypedProgram) -> list[Assumption]:
    """The assumptions for the numbers in a program that `soter identify` fitted to logs."""
    return [
        Assumption(f"identified {name}", in_words("identified", name, n, n + 1))
        for name, n in program.identified.items()
    ]


AGES = (
    "`ttf` also holds where {}: that takes control from AC and never gives it, and the proof does "
    "not go by it; AC keeps control only while it is false"
)


def ttf_of_states(ttf: TypedExpr | None) -> TypedExpr | None:
    """The part of `ttf` without disjuncts that read an age; all of `ttf` if no part remains."""
    if ttf is None or not _reads_age(ttf):
        return ttf
    left = [part for part in disjuncts(ttf) if not _reads_age(part)]
    if not left:
        return ttf
    return reduce(lambda a, b: typed.TypedBinary(BOOL, a.span, "||", a, b), left)


def note_on_ages(ttf: TypedExpr | None) -> tuple[str, ...]:
    """A note about the parts of `ttf` that `ttf_of_states` leaves out; empty without such parts."""
    left = ttf_of_states(ttf)
    if ttf is None or left is None or left is ttf:
        return ()
    parts = [p.span.text_on_one_line for p in disjuncts(ttf) if _reads_age(p)]
    return (AGES.format(" or ".join(f"`{p}`" for p in parts)),)


def _reads_age(e: TypedExpr) -> bool:
    return any(isinstance(n, typed.AgeRead) for n in nodes([e]))


UNKNOWN_FACTS = {
    typed.TimeRead: "`time`",
    typed.AgeRead: "`age(...)`",
    typed.ModeRead: "`mode(...)`",
    typed.MarginRead: "`margin(...)`",
    typed.InControl: "`in_control`",
}
OF_MODES = (
    "modes of other modules may stand in SC, `ttf` and `safer`; another mode may change at any "
    "instant, so `safe` has to hold in all of them"
)
LOCAL_VALUES_MAX = 2**31


def check_supported(
    place: VerificationSystem, diagnostics: Diagnostics, *, synthesize: bool
) -> ProblemKind:
    """Reports constructs that proofs cannot follow; returns "flow" or "map", how plants move."""
    _check_controller(place, diagnostics, synthesize=synthesize)
    kinds: dict[str, Component] = {}
    for c in place.plants:
        _check_plant(c, place, diagnostics, kinds)
    _refuse_choices(place, diagnostics)
    if not place.plants:
        diagnostics.error(
            "R002",
            f"module `{place.module.symbol.name}` has no plant to be verified with",
            place.module.symbol.span,
            notes=("what a module does to the world is proved about a model of the world",),
            helps=(
                "put a plant that drives the module's topics into its system",
                "or name one: `verify { abstracts d by model: Model = d.truth; }`",
            ),
        )
    if place.plants and not kinds and not diagnostics.has_errors:
        diagnostics.error(
            "R002",
            f"no plant that module `{place.module.symbol.name}` is verified with moves",
            place.plants[0].span,
            "no state of it has `der` or `next`",
            notes=("what a module does to the world is proved about a model of the world",),
            helps=("say how its states move: `der x = ...;`",),
        )
    if len(kinds) > 1:
        diagnostics.error(
            "R005",
            "verification plants with `der` and with `next` cannot be mixed",
            kinds["map"].span,
            "has `next`",
            also=((kinds["flow"].span, "has `der`"),),
            notes=("a flow is proved at every instant, a map at the multiples of its period",),
            helps=("write both the same way",),
        )
    _check_predicates(place, diagnostics)
    return "map" if "map" in kinds else "flow"


def _check_controller(
    place: VerificationSystem, diagnostics: Diagnostics, *, synthesize: bool
) -> None:
    node = place.flat.components[place.home.sc].node
    assert node is not None
    symbol = place.module.symbol
    if node.name == typed.SYNTHESIZED:
        if not synthesize:
            diagnostics.error(
                "R004",
                f"module `{symbol.name}` has no safe controller yet",
                node.span,
                helps=("find one: `soter verify --synthesize`",),
            )
        return
    if node.extern:
        diagnostics.error(
            "R003",
            f"the safe controller `{node.name}` is extern",
            symbol.sc_span or symbol.span,
            also=((node.span, "declared here"),),
            notes=("a proof reads the controller's own source",),
            helps=("write it in Soter", "or leave it out: `sc synthesized period 10ms;`"),
        )
        return
    _refuse_unknown_facts(node.step, f"the safe controller `{node.name}`", diagnostics)
    for variable in node.locals:
        unbounded = [t for _, t in leaves(variable.type) if not _is_bounded(t)]
        if unbounded and symbol.rest is None:
            diagnostics.error(
                "R004",
                f"the safe controller `{node.name}` keeps `{variable.name}`, which has no bounds",
                variable.span,
                f"a `{unbounded[0]}`",
                notes=("what it keeps may have any value when it takes over",),
                helps=("give it a type with few values: `int in [0, 9]`, `bool`, an `enum`",),
            )


def _is_bounded(t: Type) -> bool:
    if isinstance(t, IntType):
        return t.high - t.low < LOCAL_VALUES_MAX
    return isinstance(t, (BoolType, EnumType))


def _refuse_choices(place: VerificationSystem, diagnostics: Diagnostics) -> None:
    """Reports R007 for each plant that uses `choose`, in the proof or in the flying system."""
    seen: set[typed.PlantSymbol] = set()
    for c in (*place.plants, *place.flat.components):
        if c.plant is None or c.plant in seen:
            continue
        seen.add(c.plant)
        choice = next(
            (n for n in nodes(plant_code(c.plant)) if isinstance(n, typed.TypedChoose)), None
        )
        if choice is not None:
            diagnostics.error(
                "R007",
                f"plant `{c.name}` chooses, which a proof does not follow",
                choice.span,
                notes=("a proof is about all that disturbances may be, not about alternatives",),
                helps=("make it a `disturbance` with its bounds", "or test it: `soter test`"),
            )


def _check_plant(
    c: Component, place: VerificationSystem, diagnostics: Diagnostics, kinds: dict[str, Component]
) -> None:
    plant = c.plant
    assert plant is not None
    if plant.extern:
        diagnostics.error(
            "R006",
            f"plant `{c.name}` is extern",
            plant.span,
            notes=("nothing is known about its dynamics",),
            helps=(
                "write a model that it conforms to",
                "and name it: `verify { abstracts d by model: Model = ...; }`",
            ),
        )
        return
    if plant.der:
        kinds.setdefault("flow", c)
    if plant.next:
        kinds.setdefault("map", c)
    lets = [e for _, e in plant.lets]
    equations = [*lets, *plant.der.values(), *plant.next.values()]
    _refuse_unknown_facts(equations, f"plant `{c.name}`", diagnostics)
    for symbol, read in topic_reads(*equations).items():
        index = c.scope.topics[symbol]
        if index not in place.module.outputs:
            diagnostics.error(
                "R007",
                f"the dynamics of `{c.name}` read `{symbol.name}`, no output of the module",
                read.span,
                also=((place.module.symbol.span, "the module"),),
                notes=(
                    "what others publish may move a plant of a proof as floats of declared sets",
                ),
                helps=(
                    f"declare its set: `topic {symbol.name}: ... in [low, high];`",
                    "or make it a `disturbance` with its bounds, or a state of the plant",
                ),
            )


def _check_predicates(place: VerificationSystem, diagnostics: Diagnostics) -> None:
    """Reports each predicate of the module that a proof cannot follow."""
    symbol = place.module.symbol
    maps = set(topics_of_proved_maps(place).values())
    check_maps(place, diagnostics)
    for name, e in (("safe", symbol.safe), ("core", symbol.verify.core)):
        if e is None:
            continue
        _refuse_unknown_facts([e], f"`{name}`", diagnostics)
        for topic, read in topic_reads(e).items():
            index = place.module.scope.topics[topic]
            if index not in place.driven and not (name == "safe" and index in maps):
                driven = "put the plant that drives it beside the module, or use `abstracts`"
                followed = name == "safe" and symbol.rest is not None
                a_map = (
                    "`static` at its end, if what it calls free stays free (`soter explain static`)"
                )
                diagnostics.error(
                    "R001",
                    f"`{name}` reads `{topic.name}`, which no verification plant drives",
                    read.span,
                    also=((topic.span, "declared here"),),
                    notes=("it is proved on the plant's true state",),
                    helps=(a_map, driven) if followed else (driven,),
                )
    for name, e in (("ttf", ttf_of_states(symbol.ttf)), ("safer", symbol.safer)):
        if e is not None:
            _refuse_unknown_facts([e], f"`{name}`", diagnostics)


def _refuse_unknown_facts(roots: object, where: str, diagnostics: Diagnostics) -> None:
    """Reports R007 for each read of a clock, age or mode, and R003 for each call of an extern."""
    assert isinstance(roots, (list, tuple))
    for node in nodes(roots):
        word = UNKNOWN_FACTS.get(type(node))
        if word is not None and isinstance(node, typed.TypedExpr):
            notes: tuple[str, ...] = (
                "sets are over the plant's state; what else decides is unknown there",
            )
            if isinstance(node, typed.ModeRead):
                notes = (OF_MODES,)
            diagnostics.error(
                "R007", f"{where} reads {word}, which a proof cannot follow", node.span, notes=notes
            )
    _refuse_externs(where, roots, set(), diagnostics)


def _refuse_externs(where: str, roots: object, seen: set[object], diagnostics: Diagnostics) -> None:
    """Reports R003 for calls of extern functions, direct or through others."""
    assert isinstance(roots, (list, tuple))
    for call in calls_in(*roots):
        if call.fun in seen:
            continue
        seen.add(call.fun)
        if call.fun.body is None:
            span: Span = call.span
            diagnostics.error(
                "R003",
                f"{where} calls the extern function `{call.fun.name}`",
                span,
                notes=("a proof reads the source of everything it is about",),
                helps=("write the function in Soter",),
            )
        else:
            _refuse_externs(where, call.fun.body, seen, diagnostics)
