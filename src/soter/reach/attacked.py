"""A system under attack: the same plants and SC, everything else chosen by an adversary.

Purpose: the closed system in which `refute.py` looks for runs that leave C. The AC publishes what
is drawn from its control set, so that one draw policy chooses everything the environment and the AC
may choose, natively and in the interpreter alike; `safe` becomes a property of the *true* topics,
which are published without measurement errors beside the estimates.
Non-goals: searching (`refute.py`); delays and jitter: virtual time has none, so what only a late
release brings about is not found here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.system import Component, InputDrive, Property, Scope, System, Topic
from soter.program.types import FloatType, leaves
from soter.program.walk import nodes, topic_reads

if TYPE_CHECKING:
    from soter.program.system import Module

OWN, DRAWN = "own", "drawn"
"""Whose outputs the AC's are: those of the program's AC, or the adversary's draws."""


class NotAttackableError(Exception):
    """The closed system cannot be run as an attack; the message says why, in words."""


def attacked(system: System, module: int, controller: str = DRAWN) -> System:
    """`system` with only "safe on the true state" of this module as its property.

    Raises `NotAttackableError` where `safe` reads what no plant drives, or where the AC's outputs
    have no sets to draw from (`controller` = DRAWN).
    """
    maker = _Maker(system, system.modules[module])
    maker.watch_safe()
    maker.draw_inputs()
    if controller == DRAWN:
        maker.draw_controls()
    return maker.system()


def truths_known_ns(system: System) -> int:
    """From this time on every true topic of an attacked system has been published."""
    return max((c.phase_ns for c in system.components if c.plant is not None), default=0)


def reads_time(system: System, module: int) -> bool:
    """Whether anything in the closed system could depend on what time it is.

    Conservative: every function of the program counts, whether it is called or not.
    """
    m = system.modules[module]
    roots: list[object] = [m.symbol.ttf, m.symbol.safer]
    for c in system.components:
        if c.node is not None:
            roots += [*c.node.step, *(c.node.takeover or ())]
        if c.plant is not None:
            p = c.plant
            roots += [*p.der.values(), *p.next.values(), *(e for _, e in (*p.lets, *p.drives))]
    for f in system.program.funs.values():
        roots += list(f.body or ())
    aging = (typed.TimeRead, typed.AgeRead)
    return any(isinstance(n, aging) for n in nodes([r for r in roots if r is not None]))


class _Maker:
    """Builds the variant piece by piece; the given system stays as it is."""

    def __init__(self, system: System, module: Module) -> None:
        self.original = system
        self.module = module
        self.topics: list[Topic] = list(system.topics)
        self.components: list[Component] = list(system.components)
        self.inputs: list[InputDrive] = list(system.inputs)
        self.properties: tuple[Property, ...] = ()

    def system(self) -> System:
        return replace(
            self.original,
            topics=tuple(self.topics),
            components=tuple(self.components),
            inputs=tuple(self.inputs),
            properties=self.properties,
        )

    # ------------------------------------------------------------ safe, on the truth

    def watch_safe(self) -> None:
        """One property: `safe` over twins of its topics that carry no measurement error."""
        safe = self.module.symbol.safe
        scope = self.module.scope
        seen = {s: scope.topics[s] for s in topic_reads(safe)}
        for symbol, index in list(seen.items()):
            seen[symbol] = self._twin(symbol, index)
        self.properties = (
            Property(
                0,
                "always",
                safe,
                Scope({**scope.topics, **seen}, scope.params, scope.plants, scope.modules),
                "safe, on the true state",
                safe.span,
            ),
        )

    def _twin(self, symbol: typed.TopicSymbol, index: int) -> int:
        """A topic that its plant drives with the true value of the topic `index`."""
        for c in self.components:
            if c.plant is None:
                continue
            for topic, value in c.plant.drives:
                if c.scope.topics[topic] == index:
                    return self._driven_twin(c, topic, value, index)
        raise NotAttackableError(f"no plant drives `{symbol.name}`, which `safe` reads")

    def _driven_twin(
        self, c: Component, topic: typed.TopicSymbol, value: typed.Expr, index: int
    ) -> int:
        old = self.topics[index]
        symbol = replace(topic, name=self._fresh(f"{topic.name}_true"), input=False, values={})
        free = (None,) * len(old.bounds)
        name = self._fresh(f"{old.name}_true")
        twin = self._topic(name, symbol, old, bounds=free, set_declared=False, driver=c.name)
        assert c.plant is not None
        plant = replace(c.plant, drives=(*c.plant.drives, (symbol, value)))
        scope = replace(c.scope, topics={**c.scope.topics, symbol: twin.index})
        self.components[c.index] = replace(c, plant=plant, scope=scope)
        return twin.index

    # ------------------------------------------------------------ draws

    def draw_inputs(self) -> None:
        """Inputs nobody drives take values of their declared sets, one a module period."""
        drawn = {i.topic for i in self.inputs}
        for t in self.original.topics:
            if t.driver in ("", "input") and t.index not in drawn and _can_be_drawn(t):
                self.inputs.append(InputDrive(t.index, self.module.period_ns))

    def draw_controls(self) -> None:
        """The AC publishes, at each step, values drawn from its outputs' sets."""
        ac = self.components[self.module.ac]
        node = ac.node
        assert node is not None, ac.name
        bad = [t.name for t in node.publishes if not _can_be_drawn(self._output(ac, t))]
        if bad:
            raise NotAttackableError(f"`{bad[0]}` has no declared set to choose from")
        subscribed, step, scope = [], [], dict(ac.scope.topics)
        for topic in node.publishes:
            old = self._output(ac, topic)
            name = self._fresh(f"{old.name}_chosen")
            symbol = replace(topic, name=name, input=True)
            chosen = self._topic(name, symbol, old, max_age_ns=None, driver="input")
            self.inputs.append(InputDrive(chosen.index, ac.period_ns))
            scope[symbol] = chosen.index
            subscribed.append(typed.Subscribed(symbol, None, "", node.span))
            read = typed.TopicRead(topic.type, node.span, symbol)
            step.append(typed.Publish(node.span, topic, read))
        drawn = replace(
            node,
            extern=False,
            source=None,
            subscribes=tuple(subscribed),
            locals=(),
            initial=(),
            takeover=None,
            step=tuple(step),
        )
        self.components[ac.index] = replace(
            ac, node=drawn, scope=replace(ac.scope, topics=scope), initial=(), binding=None
        )

    def _output(self, ac: Component, topic: typed.TopicSymbol) -> Topic:
        return self.topics[ac.scope.topics[topic]]

    # ------------------------------------------------------------ shared

    def _topic(self, name: str, symbol: typed.TopicSymbol, old: Topic, **changes: object) -> Topic:
        index = len(self.topics)
        made = replace(old, index=index, name=name, symbol=symbol, **changes)  # type: ignore[arg-type]
        self.topics.append(made)
        return made

    def _fresh(self, name: str) -> str:
        taken = {t.name for t in self.topics} | {t.symbol.name for t in self.topics}
        while name in taken:
            name += "_"
        return name


def _can_be_drawn(topic: Topic) -> bool:
    """Whether every leaf has a bounded set; lists have no fixed leaves."""
    found = list(leaves(topic.type))
    return len(found) == len(topic.bounds) and all(
        "[]" not in path and (bound is not None or not isinstance(t, FloatType))
        for (path, t), bound in zip(found, topic.bounds, strict=True)
    )
