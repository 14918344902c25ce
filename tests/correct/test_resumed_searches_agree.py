"""A search that is ended anywhere, again and again, says in the end what one in one piece says.

SOTER_RESUMED_PROGRAMS=500 pytest tests/correct/test_resumed_searches_agree.py -n 2
SOTER_RESUMED_ONLY=17 pytest tests/correct/test_resumed_searches_agree.py    one, by its number
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from generators.interrupted import anywhere, bounds, chance, in_one_piece, in_pieces
from generators.programs_apart import program_apart
from generators.programs_in_instants import program_in_instants
from generators.small_programs import small_program
from soter.diagnostics.diagnostic import SoterError
from soter.explore.results import Options
from soter.program.build import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.program.model.system import System

CHUNKS = 4
PROGRAMS = int(os.environ.get("SOTER_RESUMED_PROGRAMS", "36"))
ONLY = os.environ.get("SOTER_RESUMED_ONLY")
MAKERS = (small_program, program_apart, program_in_instants)
MOST = 20_000
"""Configurations of a program that is compared."""
WAYS = (
    Options(reduction="none"),
    Options(reduction="sleep"),
    Options(reduction="none", storage="fingerprint"),
    Options(reduction="sleep", storage="fingerprint", threads=2),
    Options(reduction="none", threads=2),
    Options(reduction="instants"),
    Options(reduction="groups"),
    Options(reduction="all"),
    Options(reduction="all", threads=2),
)


def program(seed: int) -> tuple[str, System | None]:
    """Program number `seed`, and its test; None where it is refused."""
    text = MAKERS[seed % len(MAKERS)](seed)
    try:
        return text, system_of_test(check_file(f"p{seed}.soter", text), "T")
    except SoterError:
        return text, None


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_in_pieces_a_search_says_the_same(chunk: int, tmp_path: Path) -> None:
    pieces = middles = 0
    for seed in [int(ONLY)] if ONLY else range(chunk, PROGRAMS, CHUNKS):
        text, system = program(seed)
        if system is None:
            continue
        random = chance(seed)
        with anywhere():
            for number, way in enumerate(random.sample(WAYS, 3)):
                place = tmp_path / f"{seed}-{number}"
                whole = in_one_piece(system, way, tmp_path / f"{seed}-{number}-whole")
                if whole.states > MOST:
                    break
                said = in_pieces(system, way, place, random, bounds(random, whole.states))
                pieces += said.pieces
                middles += said.middles
                assert said == whole, f"{way}\n{said}\n{whole}\nprogram {seed}:\n{text}"
    print(f"{pieces} pieces, {middles} ended in the middle of a layer")
    assert ONLY or middles > PROGRAMS // 4
