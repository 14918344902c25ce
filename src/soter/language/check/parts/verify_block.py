"""Checks `verify` blocks: names, types and constants of what `soter verify` needs.

Purpose: turns grids, abstractions, commands and times into a `TypedVerifyBlock`.
Non-goals: values of the numbers (`make_modules.py`), whether a proof can use them (`verify/`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.check.checker_interface import Context, names_mentioned
from soter.language.check.dots_and_brackets import hint_to_one_number, path_and_type
from soter.language.check.expression_base import CheckerPart, has_error
from soter.language.model import typed
from soter.language.model.types import BOOL, DURATION, FLOAT, INT, FloatType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type
    from soter.language.syntax import tree

AxisKey = tuple[object, tuple[str, ...]]
Place = tuple["typed.TopicSymbol | None", tuple[str, ...], "typed.PlantSymbol | None"]
"""What an axis names: (topic, path, None), or (None, path, plant) of a plant's state."""


class VerifyChecker(CheckerPart):
    """Checks the `verify` blocks of one program."""

    def check(self, module: typed.ModuleSymbol, verify: tree.VerifyBlock, scope: FileScope) -> None:
        """Sets `module.verify` to the checked block, and the subscriptions of a synthesized SC."""
        block = module.verify = typed.TypedVerifyBlock(span=verify.span)
        self._check_times(block, verify, scope)
        self._check_axes_and_abstractions(module, verify, scope)
        block.views = tuple(self._check_views(module, verify, scope))
        block.commands = tuple(self._check_commands(module, verify, scope))
        if verify.core is not None:
            context = Context(scope, f"module `{module.name}`", topics="any")
            block.core = self.shared.check_expr(verify.core, context, BOOL)
        if verify.enters is not None:
            context = Context(scope, f"`enters` of module `{module.name}`", topics="any")
            block.enters = self.shared.check_expr(verify.enters, context, BOOL)
        block.induction = verify.induction
        lemma = Context(scope, f"a lemma of module `{module.name}`", topics="any", has_modes=True)
        block.lemmas = tuple(self.shared.check_expr(e, lemma, BOOL) for e in verify.lemmas)
        block.progress = tuple(self.shared.check_expr(e, lemma, BOOL) for e in verify.progress)
        if module.synthesized:
            topics = [a.topic for g in block.groups for a in g.axes if a.topic is not None]
            module.sc.subscribes = tuple(
                typed.Subscribed(t, None, "drop_oldest", verify.span) for t in dict.fromkeys(topics)
            )

    def _check_axes_and_abstractions(
        self, module: typed.ModuleSymbol, where: tree.VerifyBlock | tree.View, scope: FileScope
    ) -> None:
        """Checks the abstractions and groups in `where`, and enters them in `module.verify`."""
        module.verify.abstracts = tuple(
            link
            for instance, parts in where.abstracts
            for link in self._check_links(module, instance, parts, scope)
        )
        module.verify.groups = tuple(self._check_groups(module, where, scope))

    def _check_views(
        self, module: typed.ModuleSymbol, verify: tree.VerifyBlock, scope: FileScope
    ) -> Iterator[typed.ViewSymbol]:
        block = module.verify
        seen: dict[str, Span] = {}
        for view in verify.views:
            self.shared.names.enter_if_new(view.name, seen)
            module.verify = replace(block, abstracts=(), groups=(), span=view.span)
            self._check_axes_and_abstractions(module, view, scope)
            yield typed.ViewSymbol(view.name.text, module.verify, view.span)
        module.verify = block

    def _check_times(
        self, block: typed.TypedVerifyBlock, verify: tree.VerifyBlock, scope: FileScope
    ) -> None:
        context = Context(scope, "a `verify` block")

        def typed_time(expr: tree.SyntaxExpr | None, subject: str) -> typed.TypedExpr | None:
            return self.check_number_if_given(expr, context, DURATION, subject)

        block.horizon = typed_time(verify.horizon, "`horizon`")
        block.acts_least = typed_time(verify.acts_least, "the least time of `acts within`")
        block.acts = typed_time(verify.acts, "`acts within`")
        block.recover = typed_time(verify.recover, "`recover within`")
        block.stays = verify.stays
        block.dropout = typed_time(verify.dropout, "`dropout`")
        block.age = typed_time(verify.age, "`age`")

        def dm_and_sc_times(word: str, delays: tree.Delays | None) -> list[typed.TypedExpr | None]:
            nodes = {} if delays is None else self._times_by_node(word, delays)
            time_by_node = {n: typed_time(e, f"`{word} {n}`") for n, e in nodes.items()}
            setattr(block, f"{word}_of", {n: e for n, e in time_by_node.items() if e is not None})
            roles = (None, None) if delays is None else (delays.dm, delays.sc)
            return [
                typed_time(e, f"`{word} {r}`") for r, e in zip(("dm", "sc"), roles, strict=True)
            ]

        block.late_dm, block.late_sc = dm_and_sc_times("late", verify.late)
        block.response_dm, block.response_sc = dm_and_sc_times("response", verify.response)
        block.levels = self.check_number_if_given(verify.levels, context, INT, "`levels`")

    def _times_by_node(self, word: str, delays: tree.Delays) -> dict[str, tree.SyntaxExpr]:
        """Gives node name -> declared time; `soter verify` checks later if the node exists."""
        expr_by_node: dict[str, tree.SyntaxExpr] = {}
        for path, expr in delays.nodes:
            if path.text in expr_by_node:
                message = f"`{word}` says the time of `{path.text}` twice"
                self.diagnostics.error("N002", message, path.span, "again")
            expr_by_node.setdefault(path.text, expr)
        return expr_by_node

    # ------------------------------------------------------------ axes

    def _check_groups(
        self, module: typed.ModuleSymbol, verify: tree.VerifyBlock | tree.View, scope: FileScope
    ) -> list[typed.TypedAxisGroup]:
        seen: dict[AxisKey, typed.TypedGridAxis] = {}
        groups = []
        for group in verify.groups:
            axes = tuple(
                axis
                for item in group.axes
                if (axis := self._check_axis(module, item, verify, scope)) is not None
                and self._is_new_axis(axis, item, seen)
            )
            groups.append(typed.TypedAxisGroup(axes, group.span))
        return groups

    def _is_new_axis(
        self,
        axis: typed.TypedGridAxis,
        item: tree.GridAxis,
        seen: dict[AxisKey, typed.TypedGridAxis],
    ) -> bool:
        key = (axis.topic or axis.instance, axis.path)
        first = seen.setdefault(key, axis)
        if first is not axis:
            self.diagnostics.error(
                "N002",
                f"the axis `{item.path.span.text}` is given twice",
                item.path.span,
                "again",
                also=((first.span, "the first time"),),
            )
        return first is axis

    def _check_axis(
        self,
        module: typed.ModuleSymbol,
        item: tree.GridAxis,
        verify: tree.VerifyBlock | tree.View,
        scope: FileScope,
    ) -> typed.TypedGridAxis | None:
        number = self.shared.check_number
        context = Context(scope, "a `verify` block")
        low = number(item.interval.low, context, FLOAT, "a bound")
        high = number(item.interval.high, context, FLOAT, "a bound")
        cells = number(item.cells, context, INT, "the number of cells")
        end = None
        if item.open is not None:
            end = number(item.open, context, FLOAT, "the end of an open axis")
        place = self._place_of_axis(module, item.path, verify, scope)
        if place is None or has_error(low, high):
            return None
        if has_error(*(e for e in (cells, end) if e is not None)):
            return None
        (topic, path, plant), t = place
        if isinstance(t, FloatType):
            return typed.TypedGridAxis(
                topic=topic,
                path=path,
                low=low,
                high=high,
                cells=cells,
                span=item.path.span,
                instance="" if plant is None else item.path.parts[0].text,
                plant=plant,
                open=end,
                unbounded=item.unbounded,
            )
        self.diagnostics.error(
            "T001",
            f"expected `float`, found `{t}`",
            item.path.span,
            "the axis of a grid is a `float`",
            helps=(hint_to_one_number(t, item.path),),
        )
        return None

    def _place_of_axis(
        self,
        module: typed.ModuleSymbol,
        path: tree.DottedPath,
        verify: tree.VerifyBlock | tree.View,
        scope: FileScope,
    ) -> tuple[Place, Type] | None:
        """Gives the place in a topic or plant state that an axis names, and its type; or None."""
        first = path.parts[0].text
        plants = {link.name: link.plant for link in module.verify.abstracts}
        if first not in plants and any(
            part.name.text == first for _, parts in verify.abstracts for part in parts
        ):
            return None  # its plant has an error that was reported
        if not plants and first not in scope.entries and first not in scope.imports:
            plants = self._plants_in_systems_with(module)
        if first in plants:
            return self._place_of_state(path, plants[first], scope)
        topic = self.shared.topic_of_path(path, scope)
        if topic is None:
            return None
        return (topic[0], topic[1], None), topic[2]

    def _place_of_state(
        self, path: tree.DottedPath, plant: typed.PlantSymbol, scope: FileScope
    ) -> tuple[Place, Type] | None:
        below = path_and_type(self.shared, plant.truth, path.parts, scope, plant)
        return None if below is None else ((None, below[0], plant), below[1])

    def _plants_in_systems_with(self, module: typed.ModuleSymbol) -> dict[str, typed.PlantSymbol]:
        """Gives instance name -> plant, for all plants in the systems that have the module."""
        plant_by_instance: dict[str, typed.PlantSymbol] = {}
        for home in self.shared.names.scopes:
            for entry in home.entries.values():
                system = entry.symbol
                if not isinstance(system, typed.SystemSymbol):
                    continue
                if any(i.what is module for i in system.instances):
                    for i in system.instances:
                        if isinstance(i.what, typed.PlantSymbol):
                            plant_by_instance.setdefault(i.name, i.what)
        return plant_by_instance

    # ------------------------------------------------------------ commands

    def _check_commands(
        self, module: typed.ModuleSymbol, verify: tree.VerifyBlock, scope: FileScope
    ) -> list[typed.TypedCommandSet]:
        number = self.shared.check_number
        context = Context(scope, "a `verify` block")
        command_sets: dict[AxisKey, typed.TypedCommandSet] = {}
        for item in verify.commands:
            values = [number(v, context, FLOAT, "a command") for v in item.values]
            place = self.shared.topic_of_path(item.path, scope)
            if place is None or has_error(*values):
                continue
            topic, path, t = place
            if topic not in module.sc.publishes:
                self.diagnostics.error(
                    "M009",
                    f"module `{module.name}` does not publish `{topic.name}`",
                    item.path.span,
                    "commands are for its outputs",
                    also=((topic.span, "the topic"),),
                )
            elif not isinstance(t, FloatType):
                self.diagnostics.error(
                    "T001",
                    f"expected `float`, found `{t}`",
                    item.path.span,
                    "a command is a `float`",
                    helps=(hint_to_one_number(t, item.path),),
                )
            elif (topic, path) in command_sets:
                self.diagnostics.error(
                    "N002",
                    f"the commands of `{item.path.span.text}` are given twice",
                    item.path.span,
                    "again",
                    also=((command_sets[topic, path].span, "the first time"),),
                )
            else:
                known = tuple(v for v in values if v is not None)
                command_sets[topic, path] = typed.TypedCommandSet(
                    topic, path, known, item.path.span
                )
        return list(command_sets.values())

    # ------------------------------------------------------------ abstractions

    def _check_links(
        self,
        module: typed.ModuleSymbol,
        instance: tree.Name,
        parts: tuple[tree.Abstraction, ...],
        scope: FileScope,
    ) -> list[typed.AbstractionLink]:
        """Checks `abstracts d by along: Axis = e`; `e` must be correct in each system with `d`."""
        links: list[typed.AbstractionLink] = []
        homes = self._contexts_of_systems_with(module, instance, scope)
        names: dict[str, Span] = {}
        for part in parts:
            self.shared.names.enter_if_new(part.name, names)
            plant = self.referred_symbol(part.plant, scope, "plant", typed.PlantSymbol)
            value = None
            for context in homes:
                wanted = plant.truth if plant is not None else None
                checked = self.shared.check_expr(part.value, context, wanted)
                value = value or (None if has_error(checked) else checked)
            if not homes:
                self._mark_names_used(part.value, scope)
            if plant is not None:
                links.append(
                    typed.AbstractionLink(
                        instance.text, part.name.text, plant, value, part.value.span
                    )
                )
        return links

    def _contexts_of_systems_with(
        self, module: typed.ModuleSymbol, instance: tree.Name, scope: FileScope
    ) -> list[Context]:
        """Gives a context for each system with both; reports M013 if none has the instance."""
        contexts: list[Context] = []
        lacking: list[tuple[typed.SystemSymbol, dict[str, typed.InstanceSymbol]]] = []
        for home in self.shared.names.scopes:
            for entry in home.entries.values():
                system = entry.symbol
                if not isinstance(system, typed.SystemSymbol):
                    continue
                if all(i.what is not module for i in system.instances):
                    continue
                instances = {i.name: i for i in system.instances}
                if instance.text in self.shared.lost.get(system, ()):
                    continue
                if instance.text in instances:
                    where = f"the abstraction of `{instance.text}`"
                    contexts.append(Context(scope, where, topics="any", instances=instances))
                else:
                    lacking.append((system, instances))
        if lacking and not contexts and all(s not in self.shared.damaged for s, _ in lacking):
            system, instances = lacking[0]
            self.diagnostics.error(
                "M013",
                f"system `{system.name}` has no instance `{instance.text}`",
                instance.span,
                "abstracted here",
                also=((system.span, f"has module `{module.name}`"),),
                helps=self.diagnostics.did_you_mean(instance.text, instances, instance.span),
            )
        return contexts

    def _mark_names_used(self, expr: tree.SyntaxExpr, scope: FileScope) -> None:
        """Marks the names in an expression as used, since the expression cannot be checked."""
        for qualifier, name, _ in names_mentioned(expr):
            if qualifier is not None and qualifier in scope.imports:
                scope.used_imports.add(qualifier)
            elif qualifier is None:
                self.shared.names.find_entry(scope, name)
