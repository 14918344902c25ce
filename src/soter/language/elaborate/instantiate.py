"""Walks the instances of a system: names, wires and replaces them.

Purpose: turns the tree of instances into a flat list with full names, and applies what systems say
about their parts: `force`, `replace`, wires.
Non-goals: what an instance is made into (`elaborator.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.language.check.field import listed
from soter.language.elaborate.stand_ins import ContractStandIn
from soter.language.elaborate.system_numbers import Numbers
from soter.language.elaborate.wellformed import check_messages
from soter.language.model import typed
from soter.language.model.tree_walk import nodes, topics_beside, topics_mentioned

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.elaborate.system_numbers import Values
    from soter.language.model.types import Value

Replacement = typed.NodeSymbol | typed.PlantSymbol | typed.ByContract
ROLES = ("ac", "sc")
TopicKey = tuple[str, typed.TopicSymbol]
Wires = dict[typed.TopicSymbol, TopicKey]


@dataclass(eq=False)
class PlacedInstance:
    """A plant, node or module found while walking the instances."""

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
        """AC and SC of a module, replacements applied."""
        module = self.symbol
        assert isinstance(module, typed.ModuleSymbol)
        ac = self.replaced.get(module.ac.name, module.ac)
        return ac, self.replaced.get(module.sc.name, module.sc)


@dataclass(frozen=True)
class ReplacedModule:
    """A module that was replaced as a whole, and where the program says so."""

    symbol: typed.ModuleSymbol
    span: Span


@dataclass(frozen=True)
class SubSystem:
    """A system inside the one that runs; its properties and inputs count, too."""

    system: typed.SystemSymbol
    prefix: str
    wires: list[Wires]
    params: Values


class Instantiation(Numbers):
    """Walks the instances of one system.

    What it finds is `placed`, `parts` and `params_at`; `Numbers` computes the numbers that it needs
    and has the program, the system (`symbol`), its parameters and the diagnostics.
    `draft`: the file declares no system, and this is what it would run as. It may be meant to be
    imported, so that a topic without a driver is only a warning.
    """

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
    ) -> None:
        super().__init__(program, symbol, overrides, diagnostics)
        self.draft = draft
        self.placed: list[PlacedInstance] = []
        self.parts: list[SubSystem] = []
        """The system itself, then every sub-system, outer ones first."""
        self.params_at: dict[str, Values] = {"": self.params}
        """The values of parameters in the systems, by prefix: topics belong to systems."""
        self._topics_beside: dict[typed.SystemSymbol, Collection[typed.TopicSymbol]] = {}
        self.gone: dict[str, ReplacedModule] = {}
        """Modules that a test replaced as a whole, by full name."""
        self.put_in: dict[str, Span] = {}
        """Nodes, by full name, that were put in the place of others, and where that is said."""
        self.whole_modules = False
        """Whether modules may be replaced as a whole."""
        self.partial = symbol in program.damaged or (draft and program.incomplete)
        """Whether something is missing that was reported: then absence is no error."""

    # ------------------------------------------------------------ walking instances

    def walk(self, system: typed.SystemSymbol, prefix: str, outer: list[Wires]) -> None:
        """Places every instance below `prefix`, then applies the system's `force`, `replace`."""
        around = self.params_at[prefix]
        self.parts.append(SubSystem(system, prefix, outer, around))
        if prefix:
            self.parameters.add(prefix, system.sets)
        for instance in system.instances:
            name = prefix + instance.name
            what = instance.what
            self.partial = self.partial or what in self.program.damaged
            self._check_wires(instance)
            params = self.parameters.inside(name, around)
            wires = {
                inner: self.key(target, prefix, outer) for inner, target in instance.renames.items()
            }
            if isinstance(what, typed.SystemSymbol):
                self._warn_of_ignored_sets(what, name)
                self.params_at[name + "."] = params
                self.walk(what, name + ".", [wires])
                continue
            if isinstance(what, typed.ModuleSymbol):
                damaged = self.program.damaged
                self.partial = self.partial or what.ac in damaged or what.sc in damaged
            self.placed.append(
                PlacedInstance(name, what, prefix, [wires, *outer], instance.span, params)
            )
        forced = {prefix + path: to for path, to, _ in system.forces}
        for placed in self.placed if forced else ():
            placed.forced = forced.get(placed.name, placed.forced)
        for path, by, span in system.replaces:
            self._replace(prefix, path, by, span)

    def _check_wires(self, instance: typed.InstanceSymbol) -> None:
        """Reports M013 for a wire to a topic that the instance does not have."""
        what = instance.what
        if not instance.renames or what in self.program.damaged:
            return
        beside = (
            self._topics_without_instances(what) if isinstance(what, typed.SystemSymbol) else ()
        )
        known = {*beside, *topics_mentioned(what)}
        for topic, span in instance.rename_spans.items():
            if topic not in known:
                self.diagnostics.error(
                    "M013",
                    f"`{instance.name}` has no topic `{topic.name}` that could be wired",
                    span,
                    "left of `=` stands a topic of the instance",
                    also=((what.span, f"`{what.name}` is declared here"),),
                )

    def _topics_without_instances(
        self, system: typed.SystemSymbol
    ) -> Collection[typed.TopicSymbol]:
        """The topics of a system beside its instances, computed once."""
        if system not in self._topics_beside:
            self._topics_beside[system] = frozenset(topics_beside(system))
        return self._topics_beside[system]

    def _warn_of_ignored_sets(self, inner: typed.SystemSymbol, path: str) -> None:
        """Warns (W006) of each `set` of a sub-system that has no effect in the system that runs."""
        for item in inner.sets:
            if not (item.path or self.parameters.sets(item.param, path)):
                self.diagnostics.warning(
                    "W006",
                    f"`set {item.param.name}` has no effect in system `{self.symbol.name}`",
                    item.span,
                    also=((self.symbol.span, f"this system has `{inner.name}` as a part"),),
                    notes=("the system that runs sets parameters, or those of its instances",),
                    helps=(
                        f"repeat it in `{self.symbol.name}`",
                        f"or write `{{ set {item.param.name} = ... }}` where it is used",
                    ),
                )

    def _replace(self, prefix: str, path: str, by: Replacement, span: Span) -> None:
        """Replaces what `path` names below `prefix`; M013 where that is nothing."""
        self.partial = self.partial or by in self.program.damaged
        hit = False
        for placed in tuple(self.placed):
            if placed.name.startswith(prefix):
                local = placed.name[len(prefix) :]
                hit = self._replace_in(placed, local, path, by, span) or hit
        if not hit and not self.partial:
            self._report_nothing_replaced(prefix, path, by, span)

    def _replace_in(
        self, placed: PlacedInstance, local: str, path: str, by: Replacement, span: Span
    ) -> bool:
        """Replaces an instance, or the part that `path` names; False if it names none of it."""
        symbol = placed.symbol
        if isinstance(symbol, typed.ModuleSymbol):
            if self.whole_modules and path in {local, symbol.name}:
                return self._replace_module(placed, by, span)
            return self._replace_controllers(placed, local, path, by, span)
        if placed.by_contract or path not in {local, symbol.name}:
            return False
        if isinstance(by, typed.ByContract) and isinstance(symbol, typed.NodeSymbol):
            placed.by_contract[symbol.name] = ContractStandIn(placed.name, "node", "node", (), span)
            return True
        if isinstance(by, (typed.NodeSymbol, typed.PlantSymbol)) and type(symbol) is type(by):
            self._require_same_outputs(symbol, by, span)
            self._require_same_states(placed, by, span)
            placed.symbol = by
            self.put_in[placed.name] = span
            return True
        return False

    def _report_nothing_replaced(self, prefix: str, path: str, by: Replacement, span: Span) -> None:
        plant = isinstance(by, typed.PlantSymbol)
        what = "plant" if plant else "node or module" if self.whole_modules else "node"
        names = self._names_of_replaceable(typed.PlantSymbol if plant else typed.NodeSymbol)
        if self.whole_modules and not plant:
            names += [p.name for p in self.placed if isinstance(p.symbol, typed.ModuleSymbol)]
        known = [n[len(prefix) :] for n in names if n.startswith(prefix)]
        there = "nodes and modules" if what == "node or module" else f"{what}s"
        self.diagnostics.error(
            "M013",
            f"this system has no {what} `{path}` to replace",
            span,
            notes=(f"its {there} are {listed(known)}",) if known else (),
            helps=self.diagnostics.did_you_mean(path, known, span),
        )

    def _replace_controllers(
        self, placed: PlacedInstance, local: str, path: str, by: Replacement, span: Span
    ) -> bool:
        """Replaces the controllers of a module that `path` names; False if it names none."""
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        hit = False
        for node in module.own:
            short = node.name.rsplit(".", 1)[-1]
            if path not in {node.name, short, f"{local}.{short}"}:
                continue
            hit = hit or isinstance(by, (typed.ByContract, typed.NodeSymbol))
            if isinstance(by, typed.ByContract):
                name = f"{placed.name}.{short}"
                placed.by_contract[node.name] = ContractStandIn(name, "node", "node", (), span)
            elif isinstance(by, typed.NodeSymbol):
                self._require_same_outputs(node, by, span)
                placed.replaced[node.name] = by
                check_messages(module, by, span, self.diagnostics)
        if isinstance(by, typed.NodeSymbol):
            self._require_two_controllers(placed, span)
        return hit

    def _replace_module(self, placed: PlacedInstance, by: Replacement, span: Span) -> bool:
        """Puts a node, or stand-ins by contract, in the place of a module."""
        module, p = placed.symbol, placed
        assert isinstance(module, typed.ModuleSymbol)
        if isinstance(by, typed.PlantSymbol):
            return False
        self.gone[p.name] = ReplacedModule(module, span)
        if isinstance(by, typed.NodeSymbol):
            self._require_same_outputs(module, by, span)
            self.put_in[p.name] = span
            made = [PlacedInstance(p.name, by, p.prefix, p.wires, p.span, p.params)]
        else:
            made = self._make_stand_ins(p, module, span)
        at = self.placed.index(p)
        self.placed[at : at + 1] = made
        return True

    def _make_stand_ins(
        self, p: PlacedInstance, module: typed.ModuleSymbol, span: Span
    ) -> list[PlacedInstance]:
        """A stand-in for each controller of a module."""
        stand_ins: list[PlacedInstance] = []
        controllers = p.controllers()
        names = controller_names(p.name, *controllers)
        for node, name, role in zip(controllers, names, ROLES, strict=True):
            made = PlacedInstance(name, node, p.prefix, p.wires, p.span, p.params)
            made.by_contract[node.name] = ContractStandIn(
                p.name, "module", role, module.contract, span
            )
            stand_ins.append(made)
        return stand_ins

    def _names_of_replaceable(self, kind: type) -> list[str]:
        """Full names of the plants, or of the nodes, those of modules included."""
        names = []
        for placed in self.placed:
            if isinstance(placed.symbol, kind):
                names.append(placed.name)
            elif kind is typed.NodeSymbol and isinstance(placed.symbol, typed.ModuleSymbol):
                short = (n.name.rpartition(".")[2] for n in placed.symbol.own)
                names += [f"{placed.name}.{name}" for name in short]
        return names

    def _require_same_outputs(self, old: object, new: object, span: Span) -> None:
        def outputs(s: object) -> set[typed.TopicSymbol]:
            if isinstance(s, (typed.NodeSymbol, typed.ModuleSymbol)):
                return set(s.publishes if isinstance(s, typed.NodeSymbol) else s.sc.publishes)
            return {t for t, _ in s.drives} if isinstance(s, typed.PlantSymbol) else set()

        if outputs(old) == outputs(new) or {old, new} & self.program.damaged:
            return
        assert isinstance(old, typed.Symbol)
        assert isinstance(new, typed.Symbol)
        self.partial = True  # topics without a driver now were driven by the old part
        self.diagnostics.error(
            "M014",
            f"`{new.name}` does not publish what `{old.name}` publishes",
            span,
            also=(
                (old.span, f"publishes {_names(outputs(old))}"),
                (new.span, f"publishes {_names(outputs(new))}"),
            ),
            helps=("a replacement offers the same topics",),
        )

    def conditions(self, part: SubSystem) -> list[typed.TypedExpr]:
        """The expressions of the properties of a part."""
        return expressions_of(part.system.properties)

    def _require_same_states(self, placed: PlacedInstance, by: object, span: Span) -> None:
        """Reports M014 if a property reads a state that the replacement does not have."""
        if not isinstance(by, typed.PlantSymbol):
            return
        for node in (
            node
            for part in self.parts
            for node in nodes(self.conditions(part))
            if isinstance(node, typed.TruthRead) and part.prefix + node.instance == placed.name
        ):
            if node.type != by.truth:
                self.diagnostics.error(
                    "M014",
                    f"`{by.name}` has other states than `{placed.symbol.name}`",
                    span,
                    also=((node.span, "but a property reads them here"),),
                    helps=("declare the same states, in the same order",),
                )
                return

    def _require_two_controllers(self, placed: PlacedInstance, span: Span) -> None:
        """Reports M002 if AC and SC are one node after a replacement."""
        ac, sc = placed.controllers()
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        if ac is sc and module.ac is not module.sc:
            self.diagnostics.error(
                "M002",
                f"with this, `{ac.name}` is both AC and SC of module `{module.name}`",
                span,
                also=((module.span, "the module"),),
                helps=("to run one controller alone, write `force M ac;` or `force M sc;`",),
            )

    def key(self, topic: typed.TopicSymbol, prefix: str, wires: list[Wires]) -> TopicKey:
        """The topic that a symbol means at a place in the flat system: its home and itself."""
        if topic in self.program.stand_ins:
            return self._home_of([*filter(None, prefix.split("."))], topic)
        for table in wires:
            if topic in table:
                return table[topic]
        return prefix, topic

    def _home_of(self, path: list[str], topic: typed.TopicSymbol) -> TopicKey:
        """Follows a topic, as the system at `path` names it, along all wires to its home.

        Wires may lead from instance to instance; it reports M021 if they lead in a circle.
        """
        seen: dict[tuple[tuple[str, ...], typed.TopicSymbol], Span] = {}
        while True:
            path, topic = self._in_sub_system(path, topic)
            *outer, last = path or [""]
            instance = self._system_at(outer).by_name.get(last) if path else None
            if instance is None or topic not in instance.renames:
                return "".join(f"{p}." for p in path), topic
            place = tuple(path), topic
            if place in seen:
                self._report_circle(seen)
                return "", topic
            seen[place] = instance.rename_spans[topic]
            path, topic = outer, instance.renames[topic]

    def _in_sub_system(
        self, path: list[str], topic: typed.TopicSymbol
    ) -> tuple[list[str], typed.TopicSymbol]:
        """The path and the topic of a sub-system that a mentioned topic's symbol stands for."""
        while topic in self.program.stand_ins:
            further, topic = self.program.stand_ins[topic]
            path = [*path, *further]
        return path, topic

    def _system_at(self, path: list[str]) -> typed.SystemSymbol:
        system = self.symbol
        for name in path:
            what = system.by_name[name].what
            assert isinstance(what, typed.SystemSymbol)
            system = what
        return system

    def _report_circle(self, seen: dict[tuple[tuple[str, ...], typed.TopicSymbol], Span]) -> None:
        names = [".".join((*path, topic.name)) for (path, topic) in seen]
        spans = list(seen.values())
        first = min(spans, key=lambda span: span.start)
        self.diagnostics.error(
            "M021",
            f"`{names[0]}` is wired to itself"
            if len(names) == 1
            else f"{listed(sorted(names))} are wired in a circle",
            first,
            also=tuple((s, "and back here") for s in spans if s is not first)[:1],
            notes=("a wire gives a topic the place of another one: somewhere there must be one",),
            helps=("leave one of the wires out",),
        )


def controller_names(module: str, ac: typed.NodeSymbol, sc: typed.NodeSymbol) -> tuple[str, str]:
    """Full names of the controllers of a module: `M.Fast`, or `M.ac.Fast` where that is taken."""
    short = [n.name.rpartition(".")[2] for n in (ac, sc)]
    roles = [
        f"{role}.{name}" if short[0] == short[1] or name == "dm" else name
        for role, name in zip(ROLES, short, strict=True)
    ]
    return f"{module}.{roles[0]}", f"{module}.{roles[1]}"


def expressions_of(properties: tuple[typed.PropertySymbol, ...]) -> list[typed.TypedExpr]:
    """Every expression that properties evaluate."""
    expressions = [e for p in properties for e in (p.premise, p.condition)]
    return [e for e in expressions if e is not None]


def _names(topics: set[typed.TopicSymbol]) -> str:
    return ", ".join(sorted(f"`{t.name}`" for t in topics)) or "nothing"
