"""Generates the model of a system that the explorer runs, a table after the generated program.

Purpose: `generate_model` writes `<prefix>_model` (soter_explore.h): actors, timed properties,
leaves for coverage, and how a configuration is packed.
Non-goals: which actors there are (`exploration_plan.py`), what their steps read or write
(`footprints.py`), searching (`explore/engine/c/soter_explore*.c`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen import decisions
from soter.codegen.c_types import float_number, int_number
from soter.codegen.unit import Unit, UnitBuilder
from soter.core.layout import placed_leaves, scalar
from soter.explore.model.bit_packing import u64
from soter.explore.model.packed_configuration import ConfigurationEmitter, deadline_ns
from soter.explore.search_options import LEAVES_MAX
from soter.language.model.types import EnumType, FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.explore.model.bit_packing import Packing
    from soter.explore.model.exploration_plan import ExplorationPlan, PlannedActor
    from soter.explore.model.footprints import Label
    from soter.explore.model.packed_configuration import AgeingField
    from soter.language.model.system import Bound, System, Topic
    from soter.language.model.types import Type

    Table = tuple[list[c.CTop], c.CExpr]
    """The definition of a table, behind those of tables that its rows name, and its name in C."""

KINDS = {
    "eventually": "SOTER_EVENTUALLY",
    "leadsto": "SOTER_LEADSTO",
    "invariant": "SOTER_INVARIANT",
}


@dataclass(frozen=True)
class ExplorerModel:
    """The generated unit with its model; `symbol` is the model's name in C.

    `configuration_size`: in bytes; `leaves`: topic and path of the leaves for coverage, in order.
    """

    unit: Unit
    plan: ExplorationPlan
    symbol: str
    configuration_size: int
    bits: int
    leaves: tuple[tuple[int, tuple[str, ...]], ...]


def generate_model(system: System, core: CoreSystem, plan: ExplorationPlan) -> ExplorerModel:
    """The C of a system with its model; its nodes report the branches that they take."""
    builder = _ModelBuilder(system, core, plan)
    builder.frame.branches = []
    unit = builder.build_unit()
    return ExplorerModel(
        unit,
        plan,
        builder.symbol,
        builder.configuration_size,
        builder.bits,
        tuple((x.topic, x.path) for x in builder.leaves),
    )


@dataclass(frozen=True)
class _ModelLeaf:
    topic: int
    path: tuple[str, ...]
    offset: int
    type: Type
    low: float
    high: float


class _ModelBuilder(UnitBuilder):
    def __init__(self, system: System, core: CoreSystem, plan: ExplorationPlan) -> None:
        super().__init__(system, core, None)
        assert system.test is not None
        self.plan = plan
        self.test = system.test
        self.configuration_size = 0
        self.bits = 0
        self.leaves: list[_ModelLeaf] = []
        self.held_at: dict[int, int] = {}
        self.symbol = ""
        self.configuration = ""

    # ------------------------------------------------------------ all definitions

    def added_definitions(self) -> list[c.CTop]:
        """The declarations of the model, which stand behind the program's tables."""
        unique = self.types.unique
        configurations = ConfigurationEmitter(
            self.system, self.plan, self.types, self.frame, self.layout, self.prefix
        )
        struct, packing = configurations.struct_definition(), configurations.packing
        self.configuration, self.configuration_size = configurations.name, configurations.size
        self.bits, self.held_at = packing.bits, configurations.held_at
        pack_name, unpack_name, self.symbol = unique("pack"), unique("unpack"), unique("model")
        predicates, timed = self._timed_functions_and_table()
        premise_functions, premises = self._premise_functions_and_table()
        leaf = self._leaf_table()
        tables = {
            "actor": self._actor_table(packing),
            "timed": timed,
            "leaf": leaf,
            "ageing": self._ageing_table(configurations.ageing),
            **self._mask_tables(packing),
            "premise": premises,
        }
        return [
            c.Section("model of the explorer"),
            c.Include("soter_explore_pack.h"),
            struct,
            *predicates,
            *premise_functions,
            configurations.pack_function(pack_name),
            configurations.unpack_function(unpack_name),
            *(x for definitions, _ in tables.values() for x in definitions),
            self._model_definition(
                {name: value for name, (_, value) in tables.items()},
                configurations,
                pack_name,
                unpack_name,
            ),
        ]

    # ------------------------------------------------------------ tables

    def _table(
        self, type_: str, name: str, rows: list[c.CExpr], before: list[c.CTop], comment: str
    ) -> Table:
        """A table of these rows, after the definitions `before`; `NULL` if it has no rows."""
        if not rows:
            return before, c.Name("NULL")
        unique_name = self.types.unique(name)
        value = c.Initializer(tuple((None, r) for r in rows))
        table = c.VariableDef(type_, unique_name, value, array=True, comment=comment)
        return [*before, table], c.Name(unique_name)

    def _mask_table(
        self, packing: Packing, name: str, wanted: Callable[[Label], bool], before: list[c.CTop]
    ) -> Table:
        """The table of words with ones in the wanted packed fields, and the table's C name."""
        words = [u64(x) for x in packing.mask_words(wanted)]
        return self._table("uint64_t", name, words, before, "")

    def _mask_tables(self, packing: Packing) -> dict[str, Table]:
        """The masks of packed fields in `soter_model`, by the name of its member."""
        wanted: dict[str, Callable[[Label], bool]] = {
            "observed": self.plan.observed.__contains__,
            "scheduled": lambda label: label[0] in {"time", "done", "lost"},
            "clock": lambda label: label[0] == "time",
            "dues": lambda label: label[0] == "due",
            "verdicts": lambda label: label[0] == "verdict",
        }
        return {name: self._mask_table(packing, name, test, []) for name, test in wanted.items()}

    def _first_leaf_number(self, topic: int) -> int:
        """The number of a topic's first leaf; the number of all leaves if the topic has none."""
        numbers = (i for i, x in enumerate(self.leaves) if x.topic == topic)
        return next(numbers, len(self.leaves))

    def _actor_table(self, packing: Packing) -> Table:
        rows: list[c.CExpr] = []
        before: list[c.CTop] = []
        for i, actor in enumerate(self.plan.actors):
            topics: list[c.CExpr] = [c.Number(f"{topic}U") for topic in actor.outputs]
            before, outputs = self._table(
                "uint32_t", f"outputs_{i}", topics, before, f"outputs of {actor.name}"
            )
            first = [c.Number(f"{self._first_leaf_number(topic)}U") for topic in actor.outputs]
            before, leaf = self._table("uint32_t", f"leaf_{i}", [*first], before, "")
            verdicts = self._verdict_labels(actor)
            reads, writes = actor.reads | verdicts, actor.writes | verdicts
            before, read = self._mask_table(packing, f"reads_{i}", reads.__contains__, before)
            before, written = self._mask_table(packing, f"writes_{i}", writes.__contains__, before)
            number = (
                f"{actor.component}U" if actor.input is None else f"SOTER_INPUT | {actor.input}U"
            )
            rows.append(
                c.named_fields(
                    component=c.Name(number),
                    period_ns=int_number(actor.period_ns),
                    phase_ns=int_number(actor.phase_ns),
                    window_ns=int_number(actor.window_ns),
                    overrun_ns=int_number(actor.overrun_ns),
                    least_ns=int_number(actor.least_ns),
                    skips=c.Number(f"{actor.skips}U"),
                    dependent=u64(actor.dependent),
                    visible=_bool_constant(actor.visible),
                    output=outputs,
                    leaf=leaf,
                    outputs=c.Number(f"{len(actor.outputs)}U"),
                    reads=read,
                    writes=written,
                    held=c.Number(f"{self.held_at.get(i, 0)}U"),
                )
            )
        comment = "actors: inputs, then components in deployed order"
        return self._table("soter_actor", "actors", rows, before, comment)

    def _verdict_labels(self, actor: PlannedActor) -> set[Label]:
        """The label of the last verdict, if the actor is a DM or SC and may change it."""
        if actor.component is None:
            return set()
        component = self.system.components[actor.component]
        if component.role not in {"dm", "sc"} or component.module is None:
            return set()
        return {("verdict", component.module)}

    def _timed_functions_and_table(self) -> tuple[list[c.CTop], Table]:
        """C functions of the conditions and premises of timed properties, and their table."""
        functions: list[c.CTop] = []
        rows: list[c.CExpr] = []
        for timed, lowered in zip(self.test.timed, self.core.timed, strict=True):
            predicate_names = []
            for role, predicate in (("premise", lowered.premise), ("condition", lowered.condition)):
                name = self.types.unique(f"timed_{timed.index}_{role}") if predicate else "NULL"
                if predicate is not None:
                    doc = f"{role} of {timed.kind} {timed.text}"
                    made = decisions.predicate_function(
                        self.frame, predicate, name, doc, unsafe=False
                    )
                    functions.append(made)
                predicate_names.append(c.Name(name))
            rows.append(
                c.named_fields(
                    text=c.String(timed.text),
                    kind=c.Name(KINDS[timed.kind]),
                    premise=predicate_names[0],
                    condition=predicate_names[1],
                    within_ns=int_number(deadline_ns(self.system, timed)),
                    module=c.Number(f"{timed.module or 0}U"),
                )
            )
        return functions, self._table("soter_timed", "timed", rows, [], "timed properties")

    def _premise_functions_and_table(self) -> tuple[list[c.CTop], Table]:
        """C functions of the premises of implications, and their table; NULL if none exist."""
        functions: list[c.CTop] = []
        rows: list[c.CExpr] = []
        for prop, premise in zip(self.system.properties, self.core.premises, strict=True):
            name = self.types.unique(f"premise_{prop.index}") if premise else "NULL"
            if premise is not None:
                comment = f"premise of {prop.kind} {prop.text}"
                made = decisions.predicate_function(
                    self.frame, premise, name, comment, unsafe=False
                )
                functions.append(made)
            rows.append(c.Name(name))
        if not functions:
            return [], ([], c.Name("NULL"))
        type_ = "soter_premise"
        return functions, self._table(type_, "premises", rows, [], "premises of implications")

    def _leaf_table(self) -> Table:
        for topic in self.system.topics:
            if topic.queue_of is None and not topic.held:
                offset = self.layout.topic_offset(topic.index)
                for (path, leaf, at), bound in zip(
                    placed_leaves(topic.type, offset), _bounds_outside_lists(topic), strict=True
                ):
                    low, high = (bound.low, bound.high) if bound else _type_range(leaf)
                    self.leaves.append(_ModelLeaf(topic.index, path, at, leaf, low, high))
        del self.leaves[LEAVES_MAX:]
        rows: list[c.CExpr] = []
        for leaf_ in self.leaves:
            stored = scalar(leaf_.type)
            assert stored is not None
            kind = 2 if isinstance(leaf_.type, FloatType) else int(isinstance(leaf_.type, IntType))
            rows.append(
                c.named_fields(
                    topic=c.Number(f"{leaf_.topic}U"),
                    offset=c.Number(f"{leaf_.offset}U"),
                    kind=c.Number(f"{kind}U"),
                    size=c.Number(f"{stored.size}U"),
                    is_signed=_bool_constant(stored.c_type.startswith("int")),
                    low=float_number(leaf_.low),
                    high=float_number(leaf_.high),
                )
            )
        return self._table("soter_leaf", "leaves", rows, [], "scalars of topics")

    def _ageing_table(self, fields: list[AgeingField]) -> Table:
        rows: list[c.CExpr] = [
            c.named_fields(
                at=c.Number(f"{x.at}U"),
                width=c.Number(f"{x.width}U"),
                kind=c.Name(x.kind),
                most=u64(x.most),
            )
            for x in fields
        ]
        return self._table("soter_ageing", "ageing", rows, [], "packed fields that grow older")

    def _model_definition(
        self,
        tables: dict[str, c.CExpr],
        configurations: ConfigurationEmitter,
        pack: str,
        unpack: str,
    ) -> c.VariableDef:
        """The `soter_model`; `tables`: by member of the model, the C of its table.

        `plain`: no age and no deadline is packed; `brief`: no step lasts, so no output is held.
        """
        plan, packing = self.plan, configurations.packing
        labels = {label[0] for label, _, width in packing.labelled if width}
        plain = labels.isdisjoint({"stamp", "due", "verdict", "held"})
        at, now_width = next((at, w) for label, at, w in packing.labelled if label == ("time", 0))
        assert at == 1, at  # soter_time_of

        def count(n: int) -> c.CExpr:
            return c.Number(f"{n}U")

        value = c.named_fields(
            program=c.Unary("&", c.Name(f"{self.prefix}_program")),
            actor=tables["actor"],
            timed=tables["timed"],
            leaf=tables["leaf"],
            premise=tables["premise"],
            actors=count(len(plan.actors)),
            timeds=count(len(self.test.timed)),
            leaves=count(len(self.leaves)),
            branches=count(len(self.frame.branches or ())),
            tick_ns=int_number(plan.tick_ns),
            quantum_ns=int_number(plan.quantum_ns),
            horizon_ns=int_number(plan.horizon_ns),
            ordered=_bool_constant(self.test.ordered),
            timely=_bool_constant(plan.timely),
            now_mask=u64((1 << now_width) - 1),
            sampled=_bool_constant(plan.sampled),
            plain=_bool_constant(plain),
            brief=_bool_constant("held" not in labels),
            ageing=tables["ageing"],
            ageings=count(len(configurations.ageing)),
            scheduled=tables["scheduled"],
            clock=tables["clock"],
            calendar=count(configurations.calendar),
            observed=tables["observed"],
            dues=tables["dues"],
            verdicts=tables["verdicts"],
            configuration_size=c.CallExpr("sizeof", (c.Name(self.configuration),)),
            bits=count(packing.bits),
            words=count(packing.word_count),
            pack=c.Name(pack),
            unpack=c.Name(unpack),
        )
        return c.VariableDef("soter_model", self.symbol, value, static=False)


def _bool_constant(value: bool) -> c.CExpr:
    return c.Name("true" if value else "false")


def _type_range(t: Type) -> tuple[float, float]:
    if isinstance(t, IntType):
        return float(t.low), float(t.high)
    if isinstance(t, FloatType):
        return float("-inf"), float("inf")
    return 0.0, float(len(t.members) - 1) if isinstance(t, EnumType) else 1.0


def _bounds_outside_lists(t: Topic) -> list[Bound | None]:
    """The bounds of a topic's leaves; leaves inside lists are left out."""
    return [b for (path, _), b in zip(leaves(t.type), t.bounds, strict=True) if "[]" not in path]
