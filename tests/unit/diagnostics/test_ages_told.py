"""What `check` says of ages: W034 of topics without `max_age`, W035 of units; W022 by parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import soter
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
topic front: float in [0.0, 30.0] max_age 20ms;
topic speed: float in [0.0, 1.0];
node Nav period 50ms {
  subscribes front; publishes speed; step { publish speed = front > 5.0 ? 1.0 : 0.5; }
}
node Stop period 50ms { publishes speed; step { publish speed = 0.0; } }
rta Guard {
  ac Nav; sc Stop; period 50ms; safe front > 0.2; ttf front < 0.8; safer front > 1.0;
}
plant World period 10ms {
  reads speed; drives front = clamp(d, 0.0, 30.0); state d: float = 10.0; der d = -speed;
}
system S default { w: World; module Guard; until 20s; always w.truth.d > 0.2; }
"""
SAID: dict[str, tuple[list[tuple[str, str]], list[str]]] = {
    "with a max_age": ([], []),
    "without": ([(" max_age 20ms", "")], ["W034"]),
    "without, from outside": (
        [(" max_age 20ms", ""), ("w: World;", "external topic front;"), ("w.truth.d", "front")],
        ["W034"],
    ),
    "of whole numbers": (
        [("float in [0.0, 30.0] max_age 20ms", "int in [0, 30]"), ("clamp(d", "int(clamp(d"),
         ("30.0);", "30.0));"), ("> 0.2;", "> 0;"), ("< 0.8", "< 2"), ("> 1.0", "> 3"),
         ("> 5.0", "> 5")],
        ["W034"],
    ),
    "the predicates look at its age": (
        [(" max_age 20ms", ""), ("ttf front", "ttf age(front) > seconds(30ms) || front"),
         ("safer front", "safer age(front) < seconds(30ms) && front")],
        [],
    ),
    "only ttf looks at its age": (
        [(" max_age 20ms", ""), ("ttf front", "ttf age(front) > seconds(30ms) || front")],
        ["W034"],
    ),
    "only safer looks at its age": (
        [(" max_age 20ms", ""), ("safer front", "safer age(front) < seconds(30ms) && front")],
        ["W034"],
    ),
    "an age times one": ([("safer front", "safer 1.0 * age(front) < 500.0 && front")], ["W035"]),
    "the greater of an age and zero": (
        [("safer front", "safer max(age(front), 0.0) < 500.0 && front")], ["W035"]),
    "an age on the right": ([("ttf front", "ttf 500.0 < 1.0 * age(front) || front")], ["W035"]),
    "an age and a constant": (
        [("rta Guard", "const LONG: float = 500.0;\nrta Guard"),
         ("safer front", "safer age(front) + 1.0 < LONG && front")], ["W035"]),
    "an age given to a function": (
        [("rta Guard", "fun young(a: float): bool { let b = a; return b < 500.0; }\nrta Guard"),
         ("safer front", "safer young(age(front)) && front")], ["W035"]),
    "an age that a function makes milliseconds of": (
        [("rta Guard", "fun young(a: float): bool { return 1000.0 * a < 15.0; }\nrta Guard"),
         ("safer front", "safer young(age(front)) && front")], []),
    "an age times a thousand": (
        [("safer front", "safer 1000.0 * age(front) < 15.0 && front")], []),
    "ttf that all ages fulfil": ([("ttf front", "ttf age(front) >= 0.0 || front")], ["W022"]),
    "ttf that all fresh ages fulfil": (
        [("ttf front", "ttf age(front) <= seconds(20ms) || front")], ["W022"]),
    "safer that no fresh age fulfils": (
        [("safer front", "safer age(front) > seconds(20ms) && front")], ["W022"]),
    "an age in milliseconds": ([("safer front", "safer age(front) < 15.0 && front")], ["W035"]),
    "turned round, in ttf": ([("ttf front", "ttf 15.0 <= age(front) || front")], ["W035"]),
    "without max_age, by the period": (
        [(" max_age 20ms", ""), ("ttf front", "ttf age(front) > 500.0 || front"),
         ("safer front", "safer age(front) < 0.03 && front")],
        ["W035"],
    ),
    "an age in seconds": ([("safer front", "safer age(front) < 0.015 && front")], []),
    "ttf that nothing fulfils": ([("ttf front < 0.8", "ttf front < 0.8 && front > 1.5")], ["W022"]),
    "ttf that all fulfils": ([("ttf front < 0.8", "ttf front < 0.8 || front >= 0.8")], ["W022"]),
    "safer that nothing fulfils": ([("safer front > 1.0", "safer !(front >= 0.0)")], ["W022"]),
    "ttf of one value": ([("ttf front < 0.8", "ttf front < 0.8 || front == 0.8")], []),
}  # fmt: skip


@all_rows("name", SAID)
def test_what_is_said(tmp_path: Path, name: str) -> None:
    changes, codes = SAID[name]
    text = PROGRAM
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "p.soter").write_text(text)
    report = soter.load(tmp_path / "p.soter").check()
    assert [d.code for d in report.warnings if d.code != "W001"] == codes


def test_the_least_age_is_named_with_the_warning(tmp_path: Path) -> None:
    text = PROGRAM.replace(" max_age 20ms", "").replace("World period 10ms", "World period 25ms")
    (tmp_path / "p.soter").write_text(text)
    (told,) = soter.load(tmp_path / "p.soter").check().warnings
    assert any("`max_age 50ms`" in str(h) for h in told.helps)
