"""The record that the passes of an elaboration fill, one after the other.

Purpose: `Flattening` holds what is known of a flat system so far, by the pass that adds it.
Non-goals: the passes, their order (`flatten_system.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.elaborate.passes.system_numbers import Numbers, SizeCounter
from soter.language.model import system, typed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.elaborate.passes.stand_ins import ContractStandIn, StatedValues
    from soter.language.elaborate.passes.system_numbers import Values
    from soter.language.model.types import Value

Bounds = tuple[system.Bound | None, ...]
TopicKey = tuple[str, typed.TopicSymbol]
Wires = dict[typed.TopicSymbol, TopicKey]


@dataclass(eq=False)
class PlacedInstance:
    """A plant, node or module that was found in the tree of instances."""

    name: str
    symbol: typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol
    prefix: str
    wires: list[Wires]
    span: Span
    params: Values
    """The values of parameters inside this instance."""
    forced: str | None = None
    replaced: dict[str, typed.NodeSymbol] = field(default_factory=dict)
    by_contract: dict[str, ContractStandIn] = field(default_factory=dict)
    """Name of a node's declaration -> its replacement by contract."""

    def controllers(self) -> tuple[typed.NodeSymbol, typed.NodeSymbol]:
        """Gives AC and SC of a module, or the nodes that replace them."""
        module = self.symbol
        assert isinstance(module, typed.ModuleSymbol)
        ac = self.replaced.get(module.ac.name, module.ac)
        return ac, self.replaced.get(module.sc.name, module.sc)


@dataclass(frozen=True)
class ReplacedModule:
    """A module that was replaced as a whole, and the place in the program that says so."""

    symbol: typed.ModuleSymbol
    span: Span


@dataclass(frozen=True)
class SubSystem:
    """A system inside the running system; its properties and inputs count, too."""

    system: typed.SystemSymbol
    prefix: str
    wires: list[Wires]
    params: Values


class Flattening(Numbers):
    """The parts of one flat system while it is built; the base class computes its numbers.

    `draft` says that the file declares no system, and that this one stands for the whole file,
    which may only be meant for imports. `test` is the test whose system this is.
    """

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
        test: typed.TestSymbol | None = None,
    ) -> None:
        super().__init__(program, symbol, overrides, diagnostics)
        self.draft = draft
        self.test = test
        self.partial = symbol in program.damaged or (draft and program.incomplete)
        """Whether errors in parts were reported, so that a missing part is no new error."""
        self.sizes = SizeCounter(symbol, program.system_sizes, diagnostics)

        # place_instances adds these
        self.placed: list[PlacedInstance] = []
        self.parts: list[SubSystem] = []
        """The system itself, then every sub-system, outer ones first."""
        self.params_at: dict[str, Values] = {"": self.params}
        """The values of parameters in the systems, by prefix: topics belong to systems."""
        self.gone: dict[str, ReplacedModule] = {}
        """Modules that a test replaced as a whole, by full name."""
        self.put_in: dict[str, Span] = {}
        """Full name of a node that replaced another one -> the place that says so."""

        # every pass adds the topics that it mentions first
        self.topics: list[system.Topic] = []
        self.topic_by_key: dict[TopicKey, system.Topic] = {}
        self.sets: dict[tuple[typed.TopicSymbol, int], tuple[Bounds, bool, Value]] = {}
        """What `set_and_default` gives, by topic and identity of the parameters."""

        # make_components and make_modules add these
        self.components: list[system.Component] = []
        self.plants: dict[str, int] = {}
        """Indices of plants, by full name."""
        self.unknown: set[str] = set()
        """Names of components whose period has an error, so that it is not reported again."""
        self.modules: list[system.Module] = []
        self.shields: dict[int, int] = {}
        """Index of a module -> into how many cells its shield cuts each command."""

        # the passes in `properties.py`, `stated_values.py` and `outside_values.py` add these
        self.properties: list[system.Property] = []
        self.property_reads: list[tuple[int, Span]] = []
        """Topics that properties read, and where."""
        self.margins: list[int] = []
        """Modules whose margin somebody reads."""
        self.stated: dict[typed.TestSymbol, list[StatedValues]] = {}
        self.timed: list[system.TimedProperty] = []
        self.inputs: list[system.InputDrive] = []
        self.externals: list[system.External] = []
        self.measures: list[system.Metric] = []
