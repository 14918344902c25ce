"""A certificate of a proof that stays open is accepted in part, whatever the method and the claim.

What `soter verify` writes of an undecided proof claims less, and what it claims holds: it is never
rejected, and never beyond the re-checker.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

import soter
from correct.test_shield import SMALL
from generators.handover_program import of_walls
from soter.cli.main import main
from unit.api.test_deployed_kinds import BELT, PLANNER
from unit.api.test_deploying import PROVED
from unit.certificate.tubes.test_forged_rest import PLAIN

if TYPE_CHECKING:
    from pathlib import Path

ALL = "P2a P2b P3 safer start ttf"
OF_REST = "P2a P3 safer start ttf"
"""Of a module with `rest` P2b is assumed in any case."""
WRITTEN = (
    "abs(place) < 9.0;",
    "abs(place) < 9.0;\n  ttf abs(place) > 4.0;\n  safer abs(place) < 2.05;",
)
STILL = ("clamp(-motion, -1.0, 1.0)", "0.0")
BESIDE = ("state x: float in [-1.0, 1.0]", "state x: float in [-9.9, 9.9]")
BOLD = {"ttf": ("ttf abs(place) > 4.0", "ttf abs(place) > 8.99")}
BOLD["safer"] = ("safer abs(place) < 2.05", "safer abs(place) < 8.99")
FAR = ("safer abs(place) < 2.05", "safer abs(place - 5.0) < 0.25")
SOON = (
    "grid place in [-10.0, 10.0] / 200;",
    "grid place in [-10.0, 10.0] / 200; recover within 1ms;",
)
BRAKE = "brake: 1.0 }; }"
FAULTS = "brake: clamp(1.0 + abs(1.0 / (sight.gap + 1.0e99)), 0.0, 1.0) }; }"

OPEN: dict[str, tuple[str, list[tuple[str, str]], str]] = {
    "grid, SC stands still": (PROVED, [STILL], ALL),
    "grid, a start outside": (PROVED, [BESIDE], "start"),
    "grid, a short time to return": (PROVED, [("late dm", "recover within 1ms; late dm")], "P2b"),
    "grid, a short horizon": (PROVED, [("late dm", "horizon 10ms; late dm")], "P1c"),
    "map, SC drives away": (BELT, [("clamp(-0.5", "clamp(0.5")], ALL),
    "map, a start outside": (BELT, [BESIDE], "start"),
    "map, a short time to return": (BELT, [SOON], "P2b"),
    "map, a bold ttf": (BELT, [WRITTEN, BOLD["ttf"]], "P3 ttf"),
    "map, a bold safer": (BELT, [WRITTEN, BOLD["safer"]], "P3 safer"),
    "map, a safer far off": (BELT, [WRITTEN, FAR], "P2b"),
    "shield, SC drives away": (SMALL, [("clamp(-2.0", "clamp(2.0")], ALL),
    "shield, a start outside": (SMALL, [("state x: float;", "state x: float = 1.99;")], "start"),
    "shield, a short time": (SMALL, [("late dm", "recover within 1ms; late dm")], "P2b"),
    "induction, too early": (PLANNER, [("seconds(SETTLED)", "seconds(5ms)")], ALL),
    "induction, no way back": (PLANNER, [("safer Fine", "safer false && Fine")], "P2b"),
    "views, nobody keeps `enters`": (
        of_walls(), [("asked && May(other, motion)", "asked")], "P2a P3",
    ),
    "rest, SC may fault": (
        PLAIN, [("publishes levers;\n  step { publish levers = { gas: 0.0",
                 "subscribes sight; publishes levers;\n  step { publish levers = { gas: 0.0"),
                (BRAKE, FAULTS)], OF_REST,
    ),
    "rest, SC does not brake": (PLAIN, [(BRAKE, "brake: 0.0 }; }")], OF_REST),
    "rest, within less than a period": (PLAIN, [("within 5s", "within 20ms")], OF_REST),
    "rest, within too little time": (PLAIN, [("within 5s", "within 200ms")], "start"),
    "rest, moves further": (PLAIN, [("by CREEP down", "by 0.0001 down")], OF_REST),
    "rest, a start outside": (PLAIN, [("gap: float = 60.0", "gap: float = 1.0")], "start"),
    "rest, a short horizon": (
        PLAIN, [("within 5s;", "within 5s;\n  verify { horizon 10ms; }")], "P1c",
    ),
    "rest, judged": (
        PLAIN, [(BRAKE, "brake: 0.0 }; }"), ("within 5s;", "within 5s;\n  shield;")], OF_REST,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OPEN)
def test_a_proof_that_stays_open_is_accepted_in_part(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, edits, claims = OPEN[name]
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "open.soter").write_text(text)
    report = soter.load(tmp_path / "open.soter").verify(
        cert=tmp_path / "cert", refute=False, explain=False
    )
    undecided = {
        n for m in report.modules for n, f in m.findings.items() if f.verdict == "undecided"
    }
    assert undecided - {"failsafe"} == set(claims.split())
    assert main(["recheck", str(tmp_path / "cert")]) == 4
    said = capsys.readouterr().out.splitlines()[0]
    assert re.match("ACCEPTED(, without P2b| IN PART)", said), said
