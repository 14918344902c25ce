"""Where the instances of a system stand: walked, named, wired, replaced.

Purpose: the tree of instances as a flat list with full names, and what systems say about parts
of others: `force`, `replace`, wires.
Non-goals: what an instance is made into (`elaborate.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.program.check.expressions.field import listed
from soter.program.flatten.numbers import Numbers
from soter.program.model import typed
from soter.program.model.walk import nodes, topics_beside, topics_mentioned

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.model.types import Value

TopicKey = tuple[str, typed.TopicSymbol]
Wires = dict[typed.TopicSymbol, TopicKey]


@dataclass(eq=False)
class Placed:
    """A plant, node or module found while walking the instances."""

    name: str
    symbol: typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol
    prefix: str
    wires: list[Wires]
    span: Span
    forced: str | None = None
    replaced: dict[str, typed.NodeSymbol] = field(default_factory=dict)

    def controllers(self) -> tuple[typed.NodeSymbol, typed.NodeSymbol]:
        """AC and SC of a module, replacements applied."""
        module = self.symbol
        assert isinstance(module, typed.ModuleSymbol)
        ac = self.replaced.get(module.ac.name, module.ac)
        return ac, self.replaced.get(module.sc.name, module.sc)


@dataclass(frozen=True)
class Part:
    """A system inside the one that runs: its properties and inputs come along."""

    system: typed.SystemSymbol
    prefix: str
    wires: list[Wires]


class Placing(Numbers):
    """Walks the instances of one system.

    `draft`: the system is what a file without one would run as; it may be meant for others to
    import, so that topics nobody drives are only warned about.
    """

    def __init__(
        self,
        program: typed.Program,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
    ) -> None:
        super().__init__(program, symbol, overrides, diagnostics)
        self.draft = draft
        self.placed: list[Placed] = []
        self.parts: list[Part] = []
        """The system itself, then every sub-system, outer ones first."""
        self.partial = symbol in program.damaged or (draft and program.incomplete)
        """Whether something is missing that was reported: then absence is no error."""

    # ------------------------------------------------------------ walking instances

    def walk(self, system: typed.SystemSymbol, prefix: str, outer: list[Wires]) -> None:
        """Place every instance below `prefix`, then what the system forces and replaces."""
        self.parts.append(Part(system, prefix, outer))
        for instance in system.instances:
            name = prefix + instance.name
            what = instance.what
            self.partial = self.partial or what in self.program.damaged
            self._check_wires(instance)
            wires = {
                inner: self.key(target, prefix, outer) for inner, target in instance.renames.items()
            }
            if isinstance(what, typed.SystemSymbol):
                self._ignored_sets(what)
                self.walk(what, name + ".", [wires])
                continue
            if isinstance(what, typed.ModuleSymbol):
                damaged = self.program.damaged
                self.partial = self.partial or what.ac in damaged or what.sc in damaged
            self.placed.append(Placed(name, what, prefix, [wires, *outer], instance.span))
        for path, to, _ in system.forces:
            for placed in self.placed:
                if placed.name == prefix + path:
                    placed.forced = to
        for path, by, span in system.replaces:
            self._replace(prefix, path, by, span)

    def _check_wires(self, instance: typed.InstanceSymbol) -> None:
        """M013 for a wire to a topic that the instance does not have."""
        what = instance.what
        if not instance.renames or what in self.program.damaged:
            return
        beside = topics_beside(what) if isinstance(what, typed.SystemSymbol) else []
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

    def _ignored_sets(self, inner: typed.SystemSymbol) -> None:
        for param, _, span in inner.sets:
            if all(p is not param for p, _, _ in self.symbol.sets):
                self.diagnostics.warning(
                    "W006",
                    f"`set {param.name}` has no effect in system `{self.symbol.name}`",
                    span,
                    also=((self.symbol.span, f"this system has `{inner.name}` as a part"),),
                    notes=("parameters belong to the program: the system that runs sets them",),
                    helps=(f"repeat it in `{self.symbol.name}`",),
                )

    def _replace(
        self, prefix: str, path: str, by: typed.NodeSymbol | typed.PlantSymbol, span: Span
    ) -> None:
        self.partial = self.partial or by in self.program.damaged
        hit = False
        for placed in self.placed:
            if not placed.name.startswith(prefix):
                continue
            local, symbol = placed.name[len(prefix) :], placed.symbol
            if isinstance(symbol, typed.ModuleSymbol) and isinstance(by, typed.NodeSymbol):
                for node in (symbol.ac, symbol.sc):
                    short = node.name.rsplit(".", 1)[-1]
                    if path in {node.name, short, f"{local}.{short}"}:
                        hit = True
                        self._same_outputs(node, by, span)
                        placed.replaced[node.name] = by
                self._still_two(placed, span)
            elif type(symbol) is type(by) and path in {local, symbol.name}:
                hit = True
                self._same_outputs(symbol, by, span)
                self._same_truth(placed, by, span)
                placed.symbol = by
        if not hit and not self.partial:
            what = "plant" if isinstance(by, typed.PlantSymbol) else "node"
            known = [n[len(prefix) :] for n in self._replaceable(type(by)) if n.startswith(prefix)]
            self.diagnostics.error(
                "M013",
                f"this system has no {what} `{path}` to replace",
                span,
                notes=(f"its {what}s are {listed(known)}",) if known else (),
                helps=self.diagnostics.did_you_mean(path, known),
            )

    def _replaceable(self, kind: type) -> list[str]:
        """Full names of the plants, or of the nodes, those of modules included."""
        found = []
        for placed in self.placed:
            if isinstance(placed.symbol, kind):
                found.append(placed.name)
            elif kind is typed.NodeSymbol and isinstance(placed.symbol, typed.ModuleSymbol):
                nodes_ = (placed.symbol.ac, placed.symbol.sc)
                found += [f"{placed.name}.{n.name.rpartition('.')[2]}" for n in nodes_]
        return found

    def _same_outputs(self, old: object, new: object, span: Span) -> None:
        def outputs(s: object) -> set[typed.TopicSymbol]:
            if isinstance(s, typed.NodeSymbol):
                return set(s.publishes)
            return {t for t, _ in s.drives} if isinstance(s, typed.PlantSymbol) else set()

        if outputs(old) == outputs(new) or {old, new} & self.program.damaged:
            return
        assert isinstance(old, typed.Symbol)
        assert isinstance(new, typed.Symbol)
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

    def conditions(self, part: Part) -> list[typed.Expr]:
        """The expressions of the properties of a part."""
        return expressions_of(part.system.properties)

    def _same_truth(self, placed: Placed, by: object, span: Span) -> None:
        """M014 where a property reads a state that the replacement does not have."""
        if not isinstance(by, typed.PlantSymbol):
            return
        reads = [
            (node, part.prefix + node.instance)
            for part in self.parts
            for node in nodes(self.conditions(part))
            if isinstance(node, typed.TruthRead)
        ]
        for node, name in reads:
            if name == placed.name and node.type != by.truth:
                self.diagnostics.error(
                    "M014",
                    f"`{by.name}` has other states than `{placed.symbol.name}`",
                    span,
                    also=((node.span, "but a property reads them here"),),
                    helps=("declare the same states, in the same order",),
                )
                return

    def _still_two(self, placed: Placed, span: Span) -> None:
        """AC != SC also after a replacement."""
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
        """Which topic of the flat system a topic means at a place: its home and itself."""
        stand_in = self.program.stand_ins.get(topic)
        if stand_in is not None:
            path, real = stand_in
            return self._sub_key(prefix, path, real)
        for table in wires:
            if topic in table:
                return table[topic]
        return prefix, topic

    def _sub_key(self, prefix: str, path: tuple[str, ...], topic: typed.TopicSymbol) -> TopicKey:
        """The key of a sub-system's topic, following the wires on the way down."""
        system: object = self.symbol
        at = ""
        outer: list[Wires] = []
        for part in [*filter(None, prefix.split(".")), *path]:
            if not isinstance(system, typed.SystemSymbol):
                break
            instance = next(i for i in system.instances if i.name == part)
            outer = [{i: self.key(t, at, outer) for i, t in instance.renames.items()}]
            at += part + "."
            system = instance.what
        for table in outer:
            if topic in table:
                return table[topic]
        return at, topic


def expressions_of(properties: tuple[typed.PropertySymbol, ...]) -> list[typed.Expr]:
    """Every expression that properties evaluate."""
    found = [e for p in properties for e in (p.premise, p.condition)]
    return [e for e in found if e is not None]


def _names(topics: set[typed.TopicSymbol]) -> str:
    return ", ".join(sorted(f"`{t.name}`" for t in topics)) or "nothing"
