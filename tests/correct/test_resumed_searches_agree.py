"""A search that is ended anywhere, again and again, says in the end what one in one piece says."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from generators.interrupted_searches import (
    NEVER_S,
    anywhere,
    bounds,
    chance,
    in_one_piece,
    in_pieces,
    once,
)
from generators.programs_apart import program_apart
from generators.programs_in_instants import program_in_instants
from generators.small_test_programs import small_program
from long_tests import examples, seeds
from soter.api.exploring import CheckpointOptions
from soter.diagnostics.diagnostic import SoterError
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

CHUNKS = 4
PROGRAMS = examples(12)
MAKERS = (small_program, program_apart, program_in_instants)
MOST = 20_000
"""Configurations of a program that is compared."""
WAYS = (
    SearchOptions(reduction="none"),
    SearchOptions(reduction="sleep"),
    SearchOptions(reduction="none", storage="fingerprint"),
    SearchOptions(reduction="sleep", storage="fingerprint", threads=2),
    SearchOptions(reduction="none", threads=2),
    SearchOptions(reduction="instants"),
    SearchOptions(reduction="groups"),
    SearchOptions(reduction="all"),
    SearchOptions(reduction="all", threads=2),
)


def program(seed: int) -> tuple[str, System | None]:
    """Program number `seed`, and its test; None where it is refused."""
    text = MAKERS[seed % len(MAKERS)](seed)
    try:
        return text, system_of_test(check_file(f"p{seed}.soter", text), "T")
    except SoterError:
        return text, None


PASSAGE = """soter 1;
type Place = enum {{ Before, Inside, Behind }};
topic place: Place;
input topic other: Place;
node Cart period 10ms {{
  subscribes other;
  publishes place;
  var at: Place;
  var since: int in [0, 3];
  step {{
    if at == Place.Before {{
      if other != Place.Inside && choose bool {{ at = Place.Inside; since = 0; }}
    }} elseif at == Place.Inside {{
      since = min(since + 1, 3);
      if since >= 2 && choose bool {{ at = Place.Behind; }}
    }} elseif choose bool {{
      at = Place.Before;
    }}
    publish place = at;
  }}
}}
node Clock period {every}ms {{
  publishes tick;
  var on: bool;
  step {{ on = !on; publish tick = on; }}
}}
topic tick: bool;
system Robot {{ node Cart; }}
system Hall {{
  a: Robot {{ other = b.place }};
  b: Robot {{ other = a.place }};
  node Clock;
  always tick || true;
}}
test T {{ system Hall; horizon 400ms; }}
"""


@pytest.mark.parametrize("every", [10, 30])
@pytest.mark.parametrize("way", [w for w in WAYS if w.reduction in ("groups", "all")])
def test_in_pieces_a_search_sees_nearly_as_soon_that_it_holds_for_ever(
    way: SearchOptions, every: int, tmp_path: Path
) -> None:
    text = PASSAGE.format(every=every)
    system = system_of_test(check_file("passage.soter", text), "T")
    random = chance(every)
    with anywhere():
        whole = in_one_piece(system, way, tmp_path / "whole")
        assert 0 < whole.closed_ns < 400_000_000
        as_soon = 0
        for n in range(6):
            ends = bounds(random, whole.states)
            said = in_pieces(system, way, tmp_path / str(n), random, ends)
            as_soon += said == whole
            assert said.status == whole.status
            later = said.closed_ns - whole.closed_ns  # a cut in the layer that is to be kept
            assert 0 <= later <= said.middles * math.lcm(10, every) * 1_000_000
            again = once(system, way, CheckpointOptions(tmp_path / str(n), NEVER_S, resume=True))
            assert again == said, "what had come to its end says so again"
        assert as_soon >= 2


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_in_pieces_a_search_says_the_same(chunk: int, tmp_path: Path) -> None:
    pieces = middles = 0
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
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
    assert middles > PROGRAMS // 4


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize("seed", [33, 14])
def test_fingerprints_that_are_read_again_are_known(
    seed: int, threads: int, tmp_path: Path
) -> None:
    _, system = program(seed)
    assert system is not None
    way = SearchOptions(reduction="none", storage="fingerprint", threads=threads)
    with anywhere():
        whole = once(system, way)
        for most in range(1, whole.states, 7):
            place = tmp_path / str(most)
            first = CheckpointOptions(place, NEVER_S, resume=False)
            once(system, replace(way, max_states=most), first)
            again = once(system, way, CheckpointOptions(place, NEVER_S, resume=True))
            assert again == whole, most
