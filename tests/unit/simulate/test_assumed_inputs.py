"""What a run says about its inputs: which values they take, and which never change."""

from __future__ import annotations

from soter.language.front_end import check_file, system_of
from soter.simulate.outputs.run_assumptions import of_environment

PROGRAM = """soter 1;
input topic a: int in [0, 9] = 0;
input topic b: int in [0, 9] = 0;
node N period 10ms { subscribes a queue 2, b queue 2; step { } }
system S { node N; until 1s; INPUTS }
"""


def told(inputs: str) -> list[str]:
    text = PROGRAM.replace("INPUTS", inputs)
    return of_environment(system_of(check_file("inputs.soter", text), None))


def test_an_input_is_drawn_from_its_declared_values_or_its_whole_set() -> None:
    assert told("input a in { 3, 7 } every 20ms; input b every 1s;") == [
        "a changes every 20 ms to a value drawn evenly from its 2 declared values",
        "b changes every 1 s to a value drawn evenly from its set",
    ]


def test_queues_of_inputs_are_no_inputs() -> None:
    assert told("") == ["a, b keep the default value"]
