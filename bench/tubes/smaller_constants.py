"""Checks whose constants are a little smaller than what the program declares.

    python bench/tubes/smaller_constants.py --programs 7 --holds 20000

Purpose: `KINDS`, the constants of a check that the theorem names; `smaller`, the text of a check in
which one of them is; `declared`, the least that each may be, from the text of a drawn program and
the formulas of docs/proof-flight.md and from nothing else; `unlike`, the constants that are less.
Non-goals: making the constants (`tube_check.py`), that the times themselves are right (the
enumerator of tests/generators/schedule_systems.py says so).
"""

from __future__ import annotations

import argparse
import re
import sys
from fractions import Fraction
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.small_rests import drawn  # noqa: E402
from bench.tubes.tube_module import Loop, module_of  # noqa: E402

from soter.language.front_end import check_file, system_to_prove  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.tubes.problem import TubeProblem  # noqa: E402
from soter.verify.tubes.tube_check import TubeCheck  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

BY = 0.98
KINDS = {
    "E": "ERRORS", "L, reads": "LATE_READ", "L, switches": "JITTER", "H": "WINDOW",
    "D": "DISTURBED", "D, before SC acts": "ANY",
}  # fmt: skip
"""Constants, by what the theorem calls them."""
NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e-?\d+)?")


def _of(text: str, name: str) -> re.Match[str]:
    found = re.search(rf"^const {name}: [^=]+ = (.*);$", text, re.MULTILINE)
    assert found is not None, name
    return found


def smaller(kind: str, by: float = BY) -> Callable[[str], str]:
    """A change of a check's text: every number of a constant is a part of itself."""

    def changed(text: str) -> str:
        at = _of(text, KINDS[kind])
        value = NUMBER.sub(lambda m: repr(float(m.group()) * by), at.group(1))
        return text[: at.start(1)] + value + text[at.end(1) :]

    return changed


def declared(program: str) -> dict[str, list[Fraction]]:
    """The least that the constants of a drawn program's check may be."""

    def ms(pattern: str) -> Fraction:
        found = re.search(pattern, program)
        assert found is not None, pattern
        return Fraction(found.group(1)) / 1000

    dm, sc = ms(r"rta .* period (\d+)ms"), ms(r"node Sc period (\d+)ms")
    late, late_sc = ms(r"late dm (\d+)ms"), ms(r"late dm \d+ms, sc (\d+)ms")
    takes, takes_sc = ms(r"response dm (\d+)ms"), ms(r"response dm \d+ms, sc (\d+)ms")
    acts, age = ms(r"acts within (\d+)ms"), ms(r"max_age (\d+)ms")
    waits = max(late_sc, late + takes)  # all phases are 0: r = 0
    together = Fraction(gcd(int(1000 * dm), int(1000 * sc)), 1000)
    handed = max(late + takes, sc - together + late_sc)
    reads = "see." in program[program.index("node Sc") : program.index("rta M")]
    jitter = waits + takes_sc + acts
    horizon = age + dm + handed + takes_sc + acts
    wind = re.search(r"disturbance w: float in \[-(.*), ", program)
    winds = [Fraction(wind.group(1))] if wind else []
    errors = [Fraction(e) for e in re.findall(r"see\.s\d+ within ([\d.]+)", program)]
    commands = len(re.findall(r"u\d+: float", program))
    return {
        "E": errors,
        "L, reads": [(age if reads else 0) + takes_sc + acts],
        "L, switches": [jitter],
        "H": [horizon - max(dm - late, horizon - sc - jitter)],
        "D": winds + [Fraction(0)] * commands,
        "D, before SC acts": winds + [Fraction(1)] * commands,
    }


def unlike(program: str, check: str) -> list[str]:
    """The kinds of constants of a check that are less than a program declares.

    Those of states that nothing asks for are in no check. A double may be off by its last bit.
    """
    found = []
    for kind, least in declared(program).items():
        given = [Fraction(float(x)) for x in NUMBER.findall(_of(check, KINDS[kind]).group(1))]
        fewer = least[: len(given)] if kind == "E" else least
        assert len(given) == len(fewer), kind
        if any(a < b * (1 - Fraction(1, 2**50)) for a, b in zip(given, fewer, strict=True)):
            found.append(kind)
    return found


def check_of(program: str) -> str:
    """The text of its check."""
    flat = system_to_prove(check_file("small.soter", program), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem).text_in_flight({})


def main(argv: list[str]) -> int:
    """Prints a line a kind; 3 where a variant is not seen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--programs", type=int, default=7, help="of each kind")
    parser.add_argument("--holds", type=int, default=0, help="fly them, too")
    options = parser.parse_args(argv)
    lost = total = 0
    for kind in KINDS:
        seen, flown, number, count = 0, 0, 0, 0
        while count < options.programs:
            program = drawn(number)
            number += 1
            if not any(declared(program)[kind]):
                continue
            text = check_of(program)
            changed = smaller(kind)(text)
            count += 1
            seen += unlike(program, changed) == [kind] and not unlike(program, text)
            if options.holds:
                module = module_of("small.soter", program, smaller(kind), claimed=False)
                flown += bool(Loop(module, "-O1").run("contain", 1, options.holds, 0).outside)
        lost += count - seen
        total += count
        told = f", {flown} by runs that leave the tube" if options.holds else ""
        print(f"{kind}: {seen} of {count} seen beside what the program declares{told}", flush=True)
    print(f"{total - lost} of {total} are seen")
    return 3 if lost else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
