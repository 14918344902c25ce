"""The model monitor of a module, written into a file.

Purpose: from the problem of a module to the source of its monitor, beside the program it imports.
Non-goals: the text of the node (`node.py`).
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.monitor.model_membership import topic_names
from soter.monitor.monitor_node import monitor_source
from soter.monitor.outdated_monitor_files import record_of
from soter.verify.problem.extract import extract_sets

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.language.model.system import Module, System


def write_monitor(
    system: System,
    module: Module,
    program: str,
    target: Path,
    *,
    alarm: str | None,
    params: Mapping[str, object] | None,
) -> Path:
    """Write the monitor as a trusted node that imports `program`; gives back `target`.

    `alarm`: a bool topic of the program; `params`: what the system was made with.

    `SoterError` U001 where there is no such monitor, R... where the program does not determine the
    problem, D006 where the file cannot be written.
    """
    problem = extract_sets(system, module)
    names = {
        i: n if "." in n else f"watched.{n}"
        for i, n in topic_names(system, module, problem).items()
    }
    imported = os.path.relpath(program, target.parent or ".")
    topic = None if alarm is None else f"watched.{alarm}"
    record = record_of(system, module.name, problem, params)
    text = monitor_source(problem, imported, names, topic, record)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"cannot write `{target}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error
    return target
