"""Flight k of a campaign is the run of seed `--seed` + k, every byte, whatever the system is.

Also of C that keeps something from call to call, of any number of flights and workers, and of arms.
"""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators import random_programs, stateful_externs, straight_programs
from generators.engine_comparison import until_of
from generators.flights_of_runs import alone, figures, figures_of
from long_tests import examples, seed_of
from soter import SoterError, load
from soter.campaign.batch_flights import Fleet
from soter.campaign.fly_campaign import fly_batches
from soter.cli.main import main
from soter.language.elaborate.derived_systems import with_faults
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram
from tables import all_rows

if TYPE_CHECKING:
    from generators.flights_of_runs import Figures
    from soter import Program
    from soter.language.model.system import System

PROGRAMS = examples(8)
EXTERNS = examples(1)
WALL = Path(__file__).resolve().parents[3] / "examples" / "wall"
FLIGHTS = (9, 17, 64, 1)
INSTANTS = 150
"""Of a campaign: more than any vector has lanes, one, and more than one batch."""
FAULTS = """faults {
    late Guard.dm by 2ms; skip Shape at 9000 per 1h for 40ms;
    nan Guard.Bold at 20000 per 1h for 100ms; silent Shape at 9000 per 1h for 40ms;
  }"""


def random_system(folder: Path, number: int) -> System:
    """Every second one is any program; the others have faults, some an order by chance."""
    file = folder / f"flown_{number}.soter"
    straight = straight_programs.program(number, FAULTS if number % 4 else "")
    text = random_programs.program(number) if number % 2 else straight
    file.write_text(text, encoding="utf-8")
    system = system_of(check_file(str(file)), None)
    return with_faults(system, (), shuffled=True) if number % 8 == 4 else system


def compared(system: System, number: int, count: int) -> None:
    """Flights of a system beside runs of their seeds, each run where no C was called before."""
    first, until_ns = 3 + number, until_of(system, INSTANTS)
    fleet = Fleet(system, until_ns, "-O1")
    program = NativeProgram(system, "-O1")

    @cache
    def run(seed: int) -> Figures:
        return alone(lambda: figures(program.run(until_ns, seed, keep_trace=True)))

    for workers in (1, 1 + number % 3):
        batches = list(fly_batches(fleet, range(count), first, workers))
        flown = [figures_of(f) for batch in batches for f in batch]
        assert flown == [run(first + k) for k in range(count)]


@pytest.mark.parametrize("number", range(PROGRAMS))
@pytest.mark.random
def test_flights_of_random_systems(number: int, tmp_path: Path) -> None:
    compared(random_system(tmp_path, seed_of(number)), number, FLIGHTS[number % 4])


@all_rows("kind", stateful_externs.KINDS)
@all_rows("number", range(EXTERNS))
def test_flights_of_c_that_keeps_something(kind: str, number: int, tmp_path: Path) -> None:
    system = stateful_externs.system(tmp_path, kind, number)
    place = list(stateful_externs.KINDS).index(kind)
    compared(system, number + place, FLIGHTS[place % 2 if number == 0 else number % 3])


DEEP = """soter 1;
topic pos: float max_age 100ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 10ms {{
  reads u;
  drives pos = x;
  state x: float in [-0.5, 0.5];
  disturbance w: float in [-0.1, 0.1];
  der x = u + w;
}}
node N period 10ms {{
  subscribes pos;
  publishes u;
  step {{ let x = pos; publish u = clamp({}, -1.0, 1.0); }}
}}
system S {{ p: P; node N; until 2s; always abs(p.truth.x) < 0.45; }}
"""
DEPTH = 16
EXPRESSIONS = {
    "tanh": "-tanh(x)",
    "horner": "(0.5 - 0.1 * x * " * DEPTH + "1.0" + ")" * DEPTH,
    "choices": "(x > 0.01 ? -x - " * DEPTH + "x" + " : 0.3 - x)" * DEPTH,
    "least": "min(0.9 - x, " * DEPTH + "abs(x)" + ")" * DEPTH,
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_flights_of_deep_expressions(name: str, tmp_path: Path) -> None:
    file = tmp_path / "deep.soter"
    file.write_text(DEEP.format(EXPRESSIONS[name]), encoding="utf-8")
    compared(system_of(check_file(str(file)), "S"), 1, 17)


LEARNED = """soter 1;
import "cart.soter" as cart;
import "learned.soter" as learned;
node Learned period 10ms {
  subscribes cart.motion, cart.goal;
  publishes cart.accel;
  step {
    let action = learned.act([cart.motion.x, cart.motion.v, cart.goal]);
    publish cart.accel = action[0];
  }
}
system Learnt {
  c: cart.Cart;
  module cart.SafeCart;
  replace cart.Fast by Learned;
  until 30s;
  always cart.Clear(c.truth);
}
"""


def test_flights_of_a_learned_policy(tmp_path: Path) -> None:
    shutil.copy(WALL / "cart.soter", tmp_path)
    assert main(["policy", str(WALL / "rush.zip"), "-o", str(tmp_path / "learned.soter")]) == 0
    file = tmp_path / "learnt.soter"
    file.write_text(LEARNED, encoding="utf-8")
    compared(system_of(check_file(str(file)), "Learnt"), 1, 17)


# ---------------------------------------------------------------- what cannot be flown so

BODY = "double moved(double s, double push, double gust) {"


def changed(
    folder: Path, old: str, new: str, *, file: str = "body.c", kind: str = "static"
) -> Program:
    """A program whose C keeps something, with one text in place of another."""
    program = stateful_externs.write(folder, kind, 0)
    path = folder / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return load(program)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("said", "code", "words"),
    [
        ("if (gust > 0.9) { abort(); }", "X011", "SIGABRT"),
        ("if (gust > 0.9) { *(volatile int *)8 = 1; }", "X011", "SIGSEGV"),
        ("if (gust > 0.9) { exit(0); }", "X011", "exit status 0"),
        ("if (gust > 0.9) { exit(7); }", "X011", "exit status 7"),
        ("if (gust > 0.9) { fesetround(FE_UPWARD); }", "X012", "rounds"),
    ],
)
def test_c_that_ends_or_changes_a_flight_is_told(
    said: str, code: str, words: str, tmp_path: Path
) -> None:
    program = changed(tmp_path, BODY, f"#include <fenv.h>\n{BODY} {said}")
    with pytest.raises(SoterError) as caught:
        program.campaign(flights=5, workers=2, seed=3, output=tmp_path / "c")
    (told,) = caught.value.diagnostics
    assert told.code == code
    assert words in " ".join((told.message, *told.notes))
    assert "flight 0, seed 3" in told.message


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="who ends is asked of the C library")
def test_c_that_calls_exit_does_not_wait_for_what_this_process_does_at_its_end(
    tmp_path: Path,
) -> None:
    program = changed(tmp_path, BODY, f"{BODY} if (gust > 0.9) {{ exit(7); }}")

    def flown() -> list[str]:
        libc = ctypes.CDLL(None)
        libc.__cxa_atexit(ctypes.cast(libc.pause, ctypes.c_void_p), None, None)
        try:
            program.campaign(flights=2, workers=1, seed=3, output=tmp_path / "c")
        except SoterError as error:
            return list(error.diagnostics[0].notes)
        return []

    assert "exit status 7" in " ".join(alone(flown))


@pytest.mark.parametrize(
    "kept", ["static memory mine;\n#define own() (&mine)", "#define own() (&(memory){.sum = 0.1})"]
)
def test_c_that_asks_for_vector_instructions_is_what_it_is_in_a_run(
    kept: str, tmp_path: Path
) -> None:
    nothing = "#define own() (&(memory){0})"
    of_vectors = f"#ifdef __AVX2__\n{kept}\n#else\n{nothing}\n#endif"
    program = changed(tmp_path, nothing, of_vectors, kind="nothing")
    compared(program.flat(), 1, 9)


def test_what_one_flight_reads_of_standard_input_no_other_one_misses(tmp_path: Path) -> None:
    reads = "#include <unistd.h>\ndouble moved(double s, double push, double gust) {"
    reads += " unsigned char c = 0; s += read(0, &c, 1) == 1 ? 0.001 * c : 0.0;"
    program = changed(tmp_path, BODY, reads)
    before = os.dup(0)
    with (tmp_path / "body.c").open("rb") as given:
        os.dup2(given.fileno(), 0)
    try:
        fleet = Fleet(program.flat(), 10**9, "-O1")
        flown = [figures_of(f) for f in fleet.fly(range(3), 3)]
    finally:
        os.dup2(before, 0)
        os.close(before)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    ran = NativeProgram(program.flat(), "-O1")
    assert flown == [
        alone(lambda seed=seed: figures(ran.run(10**9, seed, keep_trace=True)))  # type: ignore[misc]
        for seed in range(3, 6)
    ]


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="it sets a register of x86 processors"
)
def test_c_that_keeps_nothing_and_changes_the_processor_is_told(tmp_path: Path) -> None:
    said = "#include <xmmintrin.h>\n" + BODY + " _mm_setcsr(_mm_getcsr() | 0x8040);"
    program = changed(tmp_path, BODY, said, kind="nothing")

    def flown() -> str:
        try:
            program.campaign(flights=3, output=tmp_path / "c")
        except SoterError as error:
            return error.diagnostics[0].code
        return "flown"

    assert alone(flown) == "X012"


def test_saves_and_measures_of_c_that_keeps_something_are_refused(tmp_path: Path) -> None:
    program = load(stateful_externs.write(tmp_path / "saves", "heap", 0))
    with pytest.raises(SoterError, match="saves cannot be counted"):
        program.campaign(flights=2, saves="1s", output=tmp_path / "c")
    asks = ("abs(body.truth.s) in", "moved(body.truth.s, 0.0, 0.0) in")
    program = changed(tmp_path / "measure", *asks, file="stateful.soter")
    with pytest.raises(SoterError, match="measure `far` calls C"):
        program.campaign(flights=2, output=tmp_path / "c")
    program = changed(tmp_path / "nothing", *asks, file="stateful.soter", kind="nothing")
    assert program.campaign(flights=2, saves="1s", output=tmp_path / "c").flown == 2


def test_a_dm_asks_c_that_keeps_something_as_often_as_in_a_run(tmp_path: Path) -> None:
    """What a campaign remembers of other functions, and of properties that only nodes change."""
    dear = """fun dear(x: float): float {
  var sum = 0.0;
  for i in 0..40 { sum = sum + moved(x, 0.0, 0.01 * float(i)); }
  return sum / 40.0;
}
extern node Learned"""
    program = changed(tmp_path, "extern node Learned", dear, file="stateful.soter")
    text = (tmp_path / "stateful.soter").read_text(encoding="utf-8")
    text = text.replace("ttf abs(y) >", "ttf abs(y) + 0.1 * dear(y) >")
    text = text.replace("until 1s;", "until 1s; never u + moved(u, 0.0, 0.0) > 1.2;")
    (tmp_path / "stateful.soter").write_text(text, encoding="utf-8")
    program = load(tmp_path / "stateful.soter")
    compared(program.flat(), 1, 9)


def test_flights_are_flown_again_with_what_is_bound(tmp_path: Path) -> None:
    bound = '): float from "c:body.c:moved";', "): float;"
    changed(tmp_path, *bound, file="stateful.soter")
    text = (tmp_path / "stateful.soter").read_text(encoding="utf-8")
    fault = "faults { late Guard.dm by 15ms; }\n  until 1s;"
    (tmp_path / "stateful.soter").write_text(text.replace("until 1s;", fault), encoding="utf-8")
    program = load(tmp_path / "stateful.soter")
    program.bind("moved", f"c:{tmp_path / 'body.c'}:moved")
    flown = program.campaign(flights=4, output=tmp_path / "c")
    assert any(blame.met for blame in flown.result.blames)
    assert {b.clean_without for b in flown.result.blames if b.met} <= {True, False}


@pytest.mark.parametrize(
    ("arms", "count"), [(["ac"], 2), pytest.param(["ac", "swept"], 14, marks=pytest.mark.long)]
)
def test_every_arm_flies_the_runs_of_its_seeds(arms: list[str], count: int, tmp_path: Path) -> None:
    program = load(stateful_externs.write(tmp_path, "thread", 1))
    flown = program.campaign(flights=9, workers=2, arms=arms, output=tmp_path / "c")
    assert len(flown.arms) == count
    for arm in flown.arms:
        for flight in arm.flights[::4]:
            run = program.simulate(seed=flight.seed, arm=arm.name)
            assert figures(run) == figures_of(flight)
