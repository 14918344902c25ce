"""`soter build --target T`: which targets there are.

Purpose: the table of targets; one file here makes each.
Non-goals: making them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.targets.c99 import c99_package
from soter.targets.posix import posix_package

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.targets.package import Package, PackageFile

    Maker = Callable[[System, CoreSystem, Path], Package]

TARGETS: dict[str, Maker] = {"c": c99_package, "posix": posix_package}
"""The default first."""
COMING = ("cortex-m", "ros1", "dds", "zenoh", "mavlink")


def build_package(
    target: str, system: System, core: CoreSystem, folder: Path, more: Sequence[PackageFile] = ()
) -> Package:
    """Write the package of a target; SoterError U001 where there is no such target.

    `more`: files that it has besides, whatever the target.

    `system`, `core`: with every binding to C entered (`simulate/externs/bindings.py`); whatever
    else an extern is bound to does not leave this machine.
    """
    make = TARGETS.get(target)
    if make is None:
        known = ", ".join(f"`{t}`" for t in TARGETS)
        later = f"to come: {', '.join(COMING)}"
        what = "is still to come" if target in COMING else "does not exist"
        raise SoterError(
            (
                Diagnostic(
                    "U001",
                    f"the target `{target}` {what}",
                    notes=(later,),
                    helps=(f"there is {known}",),
                ),
            )
        )
    package = make(system, core, folder)
    package.target = target
    package.files += more
    return package.write()
