"""The channels of a program that was not built: what `soter build` would write of them.

Purpose: check a program, flatten a system, describe its channels.
Non-goals: packages (`channels_and_topics.py` reads what they say), which need none of what is
imported here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from soter.language.front_end import check_file, system_of
from soter.targets.world_interface import channel_document

if TYPE_CHECKING:
    from soter.language.model.system import System


class Declared(Protocol):
    """What `soter.load` gives: a program and its systems."""

    def declared(self, system: str | None = None) -> System:
        """A system of it; SoterError."""


def document_of(program: str | Path | Declared, system: str | None) -> dict[str, object]:
    """`channels.json` of a system; `program`: a file, or what `soter.load` gave.

    SoterError where the program has mistakes, U002 where there is no such system.
    """
    if isinstance(program, (str, Path)):
        return channel_document(system_of(check_file(str(program)), system))
    return channel_document(program.declared(system))
