"""The problem of a module, and that all of it is understood.

Purpose: `facts_of`: what has to be read off a program before any claim is looked at.
Non-goals: what of it an entry of a manifest says otherwise (`rechecker.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.module_above import read_above
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.supported_constructs import check_supported
from soter.certificate.time.sc_on_default_inputs import answers_all, survives_the_start

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import System


def facts_of(flat: System, entry: dict[str, Any]) -> Facts:
    """The problem of the module of an entry in a system.

    DiffersError where there is none, NotRecheckedError where it is not understood.
    """
    facts = read_facts(flat, entry["module"], str(entry.get("view", "")))
    read_above(facts)
    check_supported(facts)
    setting = facts.setting
    if setting.first_available(0, setting.by_sc) != setting.sc.phase:
        survives_the_start(facts)  # else every read of SC shows a state
    if facts.above is not None:
        answers_all(facts)
    return facts
