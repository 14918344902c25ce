"""What a run says about its inputs: which values they take, and which never change."""

from __future__ import annotations

from soter.language.front_end import check_file, system_of
from soter.simulate.result_assumptions import code_assumptions, environment_assumptions

PROGRAM = """soter 1;
input topic a: int in [0, 9] = 0;
input topic b: int in [0, 9] = 0;
node N period 10ms { subscribes a queue 2, b queue 2; step { } }
system S { node N; until 1s; INPUTS }
"""


def told(inputs: str) -> list[str]:
    text = PROGRAM.replace("INPUTS", inputs)
    return environment_assumptions(system_of(check_file("inputs.soter", text), None))


def test_an_input_is_drawn_from_its_declared_values_or_its_whole_set() -> None:
    assert told("input a in { 3, 7 } every 20ms; input b every 1s;") == [
        "a changes every 20 ms to a value drawn evenly from its 2 declared values",
        "b changes every 1 s to a value drawn evenly from its set",
    ]


def test_queues_of_inputs_are_no_inputs() -> None:
    assert told("") == ["a, b keep the default value"]


PLANT = """soter 1;
topic seen: { x: float unit "m", y: float unit "m", z: float unit "m", v: float unit "m/s" };
plant P period 10ms {
  drives seen = { x: x, y: x, z: x, v: x };
  state x: float = 0.0;
  disturbance wind: float unit "N" in [-1.0, 1.0];
  der x = wind;
  MEASURED
}
system S { p: P; until 1s; }
"""


def measured(clauses: str) -> str:
    text = PLANT.replace("MEASURED", f"measured {clauses};")
    _, errors = environment_assumptions(system_of(check_file("plant.soter", text), None))
    return errors


def test_a_bound_of_errors_says_its_unit_and_several_say_what_each_is_of() -> None:
    assert measured("seen.x within 0.02") == "p: measurement errors within 0.02 m, drawn evenly"
    assert measured("seen.x within 0.02, seen.y within 0.02, seen.v within 0.02") == (
        "p: measurement errors within 0.02 m of seen.x and seen.y, 0.02 m/s of seen.v, drawn evenly"
    )
    assert measured("seen.x within 0.1, seen.y within 0.1, seen.z within 0.1, seen.v within 2") == (
        "p: measurement errors within 0.1 m of 3 signals, 2 m/s of seen.v, drawn evenly"
    )


def test_a_disturbance_has_its_unit() -> None:
    text = PLANT.replace("MEASURED", "")
    (wind,) = environment_assumptions(system_of(check_file("plant.soter", text), None))
    assert wind == "p: wind in [-1, 1] N, drawn evenly"


WITHOUT_PREDICATES = """soter 1;
topic speed: float;
topic push: float in [-1.0, 1.0] = 0.0;
plant P period 10ms { reads push; drives speed = s; state s: float; next s = s + push; }
node Ac period 10ms { subscribes speed; publishes push; step { publish push = 1.0; } }
node Sc period 10ms { subscribes speed; publishes push; step { publish push = -1.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe speed < 9.0; }
system S { p: P; module M; until 1s; }
"""


def test_predicates_that_may_not_be_computed_are_not_promised() -> None:
    system = system_of(check_file("m.soter", WITHOUT_PREDICATES), None)
    (told,) = [line for line in code_assumptions(system) if "computed" in line]
    assert told.startswith("M has no ttf and no safer: computed before it runs or is built, ")
    assert told.endswith("; where they cannot be, its AC never gets control")
