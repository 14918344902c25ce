"""Which claims a certificate may make, as the re-checker reads them.

Purpose: the names of the properties, and which verdicts count.
Non-goals: showing any of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.assumptions import p1c_of
from soter.certificate.format.errors import RejectedError
from soter.certificate.module_above import slowest_below

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Module, System

CLAIMS = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start", "failsafe")
ELSEWHERE = ("DM",)
"""Said in a certificate, not confirmed here: what was compiled is not our matter."""
PROVED = "proved"
VERDICTS = ("proved", "assumed", "undecided", "refuted")


def claimed_of(given: object) -> set[str]:
    """The properties that are said to be proved; RejectedError for unknown ones, or none."""
    if not isinstance(given, dict):
        raise RejectedError("`claims` is not as it should be")
    for name, verdict in given.items():
        if name not in (*CLAIMS, *ELSEWHERE) or verdict not in VERDICTS:
            raise RejectedError(f"the claim `{name}: {verdict}` is unknown")
    claims = {name for name, verdict in given.items() if verdict == PROVED and name in CLAIMS}
    if not claims:
        raise RejectedError("nothing is claimed")
    return claims


def of_the_module(system: System, module: Module, given: dict[str, str]) -> None:
    """P1a, P1b, and that a DM can give control back; `RejectedError` where they overstate."""
    ac, sc = (system.components[i] for i in (module.ac, module.sc))
    latch = module.symbol.latch
    if given.get("P2b") == PROVED and latch is not None and latch.topic is None:
        raise RejectedError("P2b: the DM never gives control back (`returns never`)")
    below = 0 if module.over is None else slowest_below(system, module)
    if given.get("P1a") == PROVED and max(ac.period_ns, sc.period_ns, below) > module.period_ns:
        raise RejectedError("P1a: a controller is slower than the DM")
    outputs = [{*c.writes} for c in (ac, sc) if c.node]
    same = module.outputs and all(of == set(module.outputs) for of in outputs)
    if given.get("P1b") == PROVED and not same:
        raise RejectedError("P1b: AC and SC do not publish the same topics")


def static_claims(facts: Facts, given: dict[str, str]) -> None:
    """P1a, P1b and P1c are seen to once more; `RejectedError` where they overstate."""
    of_the_module(facts.flying, facts.flying_module, given)
    if given.get("failsafe") == PROVED and len(facts.tower) > 1:
        raise RejectedError("failsafe: other modules of a tower command the same actuators")
    if given.get("P2b") == PROVED and facts.above is not None:
        raise RejectedError(f"P2b: SC has control only while {facts.above.name} is in AC")
    if given.get("P1c") not in (PROVED, "assumed"):
        return
    if facts.times["H_ns"] < facts.times["H_star_ns"]:
        raise RejectedError("P1c: the horizon is shorter than H*")
    seen = {r.name for r in facts.setting.by_dm}
    blind = [r.name for r in facts.setting.by_sc if r.name not in seen]
    if blind and facts.times["H_ns"] < facts.start_ns:
        # an "AC" verdict shows nothing of what SC alone reads: only from h_0 on it is there
        raise RejectedError(f"P1c: `{blind[0]}`, which the DM does not read, may come after H")
    if given["P1c"] == PROVED != p1c_of(facts):
        raise RejectedError("P1c rests on times that are not declared: it is assumed, not proved")
