"""`soter build --target T`: which targets there are.

Purpose: the table of targets; one file here makes each.
Non-goals: making them.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class Target:
    """A target: who makes its package, and what has to be given to it beside system and Core."""

    make: str
    """`MODULE:FUNCTION`, imported when somebody builds for it: from (system, core, folder), and the
    mapping or board and run where it wants them."""
    page: str = ""
    """Of the documents: where its package is told, which has no README.md then."""
    mapped: bool = False
    """It speaks with a middleware: a mapping says which topic is which of its messages."""
    boarded: bool = False
    """It is an image: a board says where everything lies."""
    drops_bindings: bool = False
    """It leaves out what externs are bound to outside C, without a word of its own on it."""


TARGETS = {
    "c": Target("soter.targets.c99:c99_package", drops_bindings=True),
    "posix": Target("soter.targets.posix.posix_package:posix_package"),
    "ros1": Target("soter.targets.ros.ros_packages:ros1_package", "docs/ros.md", mapped=True),
    "ros2": Target("soter.targets.ros.ros_packages:ros2_package", "docs/ros.md", mapped=True),
    "dds": Target("soter.targets.dds.dds_package:dds_package", "docs/dds.md", mapped=True),
    "mavlink": Target(
        "soter.targets.mavlink.mavlink_package:mavlink_package", "docs/mavlink.md", mapped=True
    ),
    "cortex-m": Target("soter.targets.cortex_m.cortex_m_package:cortex_m_package", boarded=True),
}
"""By name, the default first: whatever else asks about targets reads it here."""


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
    module, _, name = TARGETS[target].make.partition(":")
    package: Package = getattr(by_name(module), name)(system, core, folder, *given)
    package.target = target
    package.files += more
    return package.write()


def require_options(target: str, *, mapping: bool, board: bool) -> None:
    """SoterError U001 for a target that does not exist, or a mapping or board amiss or too many."""
    if target not in TARGETS:
        known = f"there is {', '.join(f'`{t}`' for t in TARGETS)}"
        raise _unusable(f"the target `{target}` does not exist", known)
    wants = TARGETS[target]
    if board != wants.boarded:
        verb = "is for no board" if board else "needs a board: where everything lies"
        help_ = "leave --board out" if board else "--board NAME or FILE (docs/bare-metal.md)"
        raise _unusable(f"the target `{target}` {verb}", help_)
    if wants.mapped and not mapping:
        what = f"the target `{target}` needs a mapping: which topic is which of its messages"
        raise _unusable(what, "--map FILE (docs/mapping.md)")
    if mapping and not wants.mapped:
        what = f"the target `{target}` speaks with no middleware: it has no use for a mapping"
        raise _unusable(what, "leave --map out")


def _unusable(what: str, help_: str) -> SoterError:
    return SoterError((Diagnostic("U001", what, helps=(help_,)),))
