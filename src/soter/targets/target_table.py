"""`soter build --target T`: which targets there are.

Purpose: the table of targets; one file here makes each.
Non-goals: making them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.addons import by_name
from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.targets.cortex_m.board import Board
    from soter.targets.cortex_m.cortex_m_package import Replay
    from soter.targets.package import Package, PackageFile

TARGETS = {
    "c": "soter.targets.c99:c99_package",
    "posix": "soter.targets.posix:posix_package",
    "ros1": "soter.targets.ros.ros_packages:ros1_package",
    "ros2": "soter.targets.ros.ros_packages:ros2_package",
    "dds": "soter.targets.dds.dds_package:dds_package",
    "mavlink": "soter.targets.mavlink.mavlink_package:mavlink_package",
    "cortex-m": "soter.targets.cortex_m.cortex_m_package:cortex_m_package",
}
"""The default first: the function that makes it, which is imported when somebody builds for it.

It takes (system, core, folder), and the mapping where the target is in MAPPED, board and run where
it is in BOARDED."""
MAPPED = frozenset(("ros1", "ros2", "dds", "mavlink"))
"""What speaks with a middleware: a mapping says which topic is which of its messages."""
BOARDED = frozenset(("cortex-m",))
"""What is an image: a board says where everything lies."""
COMING: tuple[str, ...] = ()


def build_package(
    target: str,
    system: System,
    core: CoreSystem,
    folder: Path,
    mapping: object = None,
    more: Sequence[PackageFile] = (),
    onto: tuple[Board, Replay] | None = None,
) -> Package:
    """Write the package of a target; SoterError U001 where there is no such target, or no mapping.

    `mapping`: as `soter.mapping.read_mapping.mapping_of` gives it. `more`: files that it has
    besides, whatever the target. `onto`: a board, and the run that an image of it repeats.

    `system`, `core`: with every binding to C entered (`simulate/externs/bindings.py`); whatever
    else an extern is bound to does not leave this machine.
    """
    require_options(target, mapping=mapping is not None, board=onto is not None)
    given = onto or (() if mapping is None else (mapping,))
    module, _, name = TARGETS[target].partition(":")
    package: Package = getattr(by_name(module), name)(system, core, folder, *given)
    package.target = target
    package.files += more
    return package.write()


def require_options(target: str, *, mapping: bool, board: bool) -> None:
    """SoterError U001 for a target that does not exist, or a mapping or board amiss or too many."""
    if target not in TARGETS:
        what = "is still to come" if target in COMING else "does not exist"
        known = f"there is {', '.join(f'`{t}`' for t in TARGETS)}"
        raise _unusable(f"the target `{target}` {what}", known, *(f"to come: {t}" for t in COMING))
    if board != (target in BOARDED):
        verb = "is for no board" if board else "needs a board: where everything lies"
        help_ = "leave --board out" if board else "--board NAME or FILE (docs/bare-metal.md)"
        raise _unusable(f"the target `{target}` {verb}", help_)
    if target in MAPPED and not mapping:
        what = f"the target `{target}` needs a mapping: which topic is which of its messages"
        raise _unusable(what, "--map FILE (docs/mapping.md)")
    if target not in MAPPED and mapping:
        what = f"the target `{target}` speaks with no middleware: it has no use for a mapping"
        raise _unusable(what, "leave --map out")


def _unusable(what: str, help_: str, *notes: str) -> SoterError:
    return SoterError((Diagnostic("U001", what, notes=notes, helps=(help_,)),))
