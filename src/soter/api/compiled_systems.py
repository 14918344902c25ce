"""What runs of a program have in common: flat systems, lowered and compiled once.

Purpose: `PreparedSystems` keeps, for the last few choices of system, parameters and bindings, all
that does not depend on seed, end and Python objects; C files of externs are looked at before every
run. Safe to ask from several threads; a copy or a pickle of it is empty.
Non-goals: files of the program, which were read when it was loaded; the run (`running.py`).
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.addons import by_name
from soter.api.arguments import complete
from soter.language.front_end import system_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.front_end import CheckResult
    from soter.language.model.system import System
    from soter.language.model.types import Value
    from soter.simulate.externs.bindings import Bindings
    from soter.simulate.run import NativeProgram

KEPT_MAX = 16
"""So many choices are kept; the one that was asked for longest ago goes first."""


@dataclass(eq=False)
class PreparedSystem:
    """A system that was lowered, and compiled where the native engine ran it.

    `bindings`: of the run that prepared it; its texts are those of every run.
    """

    system: System
    computed: tuple[str, ...]
    bindings: Bindings
    linked: str = ""
    """A hash of the C files of externs that `native` was compiled with."""
    native: NativeProgram | None = None
    arm: str | None = None
    """By whose rules it runs, where these are not the program's own."""


class PreparedSystems:
    """What one `Program` has prepared."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[object, ...], PreparedSystem] = OrderedDict()
        self._lock = threading.RLock()

    def __reduce__(self) -> tuple[type[PreparedSystems], tuple[()]]:
        return PreparedSystems, ()

    def of(
        self,
        checked: CheckResult,
        name: str | None,
        values: Mapping[str, Value],
        given: Mapping[str, object],
    ) -> PreparedSystem:
        """The system `name` with these parameters and bindings, as it was or made now.

        Of what is bound only texts matter: Python objects answer, whatever the system is. Numbers
        count as they are written: 0.0 is not -0.0, nor 1 true. `SoterError` as for `system_of` and
        `bind`; nothing is kept of what fails.
        """
        from soter.simulate.externs.bindings import bind  # noqa: PLC0415 - see `soter.api`

        default = checked.default_system() if name is None else None
        texts = [(n, t if isinstance(t, str) else None) for n, t in given.items()]
        chosen = name if default is None else default.name
        key = (chosen, repr(sorted(values.items())), tuple(texts))
        with self._lock:
            preparation = self._kept.get(key)
            if preparation is None:
                system = system_of(checked, name, values)
                computed = tuple(complete(system, bound=given))
                preparation = self._kept[key] = PreparedSystem(
                    system, computed, bind(system, given)
                )
                if len(self._kept) > KEPT_MAX:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return preparation

    def of_arm(
        self, prepared: PreparedSystem, name: str, folder: str | Path | None
    ) -> PreparedSystem:
        """The same by the rules of an arm of a campaign, whose folder it is; not kept.

        SoterError U001 for a name that is none, D006 where that arm needs the folder.
        """
        system = prepared.system
        named = by_name("soter.campaign.arms").system_of_arm(system, name, Path(folder or "."))
        if named is system:
            return prepared
        bindings = replace(prepared.bindings, system=named)
        return PreparedSystem(named, prepared.computed, bindings, arm=name)

    def native(self, prepared: PreparedSystem) -> NativeProgram:
        """The compiled system; compiled again where the C of an extern is another."""
        from soter.simulate.externs.c_extern import linked_content  # noqa: PLC0415 - see `soter.api`
        from soter.simulate.run import NativeProgram  # noqa: PLC0415 - the same

        with self._lock:
            core = prepared.bindings.core
            linked = linked_content(prepared.system, core)
            if prepared.native is None or prepared.linked != linked:
                prepared.native = NativeProgram(prepared.system, core=core)
                prepared.linked = linked
            return prepared.native
