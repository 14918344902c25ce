"""Files of execution times, as `soter measure` writes them.

Purpose: `read_times` reads one; `enter_times` gives its times to the components of a system.
Non-goals: measuring (`measuring.py`); the analysis of times (`soter.timing`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import mistake
from soter.language.elaborate.passes.system_numbers import MAX_PERIOD_NS
from soter.language.load.named_files import read_json_text
from soter.version import why_format_is_unreadable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import System

TIMES_FORMAT = 1
"""Version of the format of the files that `soter measure` writes."""


def read_times(path: str | Path) -> tuple[str, str, dict[str, int], str]:
    """Reads from a file of times: the hash, system, `wcet_ns` by component, and `assumed`.

    Raises SoterError U011 if it is not such a file, OSError if it cannot be read.
    """
    why = ""
    try:
        document = json.loads(read_json_text(Path(path)))
        wcet_by_component = {s["name"]: s["wcet_ns"] for s in document["steps"]}
        why = why_format_is_unreadable(document["schema"], TIMES_FORMAT)
        sound = not why and all(
            isinstance(n, str) and type(ns) is int and 0 < ns <= MAX_PERIOD_NS
            for n, ns in wcet_by_component.items()
        )
        program, system = str(document["program_sha256"]), str(document["system"])
        assumed = str(document.get("assumed", ""))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        sound = False
    if not sound:
        notes = (*((why,) if why else ()), "`soter measure` writes one")
        raise mistake("U011", f"`{path}` is no file of times", notes=notes)
    return program, system, wcet_by_component, assumed


def enter_times(systems: Mapping[str, System], path: str | Path, sha256: str) -> dict[str, str]:
    """Sets each missing `wcet` from a file of times; raises U011 as `read_times` does.

    Returns, by system, what these times assume. Also raises U011 if the program in the file has a
    hash other than `sha256`, or has a system or component that this program lacks.
    """
    program, name, times, assumed = read_times(path)
    components = systems[name].components if name in systems else ()
    unknown = [n for n in times if n not in {c.name for c in components}]
    note = ""
    if program != sha256:
        note = f"it has those of program {program[:12]}, and this one is {sha256[:12]}"
    elif name not in systems:
        note = f"it has those of system `{name}`"
    elif unknown:
        note = f"it has those of `{unknown[0]}`, which is no part of system `{name}`"
    if note:
        message = f"`{path}` has no times of this program"
        helps = ("measure what is there now: `soter measure`",)
        raise mistake("U011", message, *helps, notes=(note,))
    for c in components:
        c.wcet_ns = times.get(c.name) if c.wcet_ns is None else c.wcet_ns
    return {name: assumed}
