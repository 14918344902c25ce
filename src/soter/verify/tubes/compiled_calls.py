"""Calls the costly functions of a text in C, where there is a compiler.

Purpose: a `CompiledCaller` answers `keeps`, `starts` and `good` by the C that Soter generates for
the text, as for any program: the same bits as by the interpreter, hundreds of times as quickly. The
node of `rest.soter` calls the function that a topic names.
Non-goals: what the functions mean (`rest.soter`), the check of the DM in flight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.codegen.unit import generate
from soter.core.layout import decode_from, encode_into, size_of, state_layout
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import system_of
from soter.native.compiler import find_compiler
from soter.native.loaded_program import Library
from soter.native.shared_library import library
from soter.verify.tubes.generated_functions import Caller

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.front_end import CheckResult

COMPILED = ("keeps", "starts", "good")
"""The functions that are called in C, in the order of their numbers in `rest.soter`."""
WORTH_COMPILING = 5_000_000
"""With fewer operations the interpreter answers sooner than a compiler starts."""
AFFORDABLE = 10**12
"""The most operations in C for all parts that are tried: they take some minutes."""


class CompiledCaller(Caller):
    """Calls the functions of an offline text: `COMPILED` in C, others in the interpreter."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._questions: CompiledQuestions | None = None
        if self.operations("keeps") >= WORTH_COMPILING and is_compiler_found():
            self._questions = CompiledQuestions(self.checked)
            self.affordable = AFFORDABLE

    def result(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401 - values of the program
        """The value that function `name` returns; None if it faults."""
        if self._questions is not None and name in COMPILED:
            answer = self._questions.answer(name, arguments)
            if answer is not None:
                self.fault = ""
                return answer
        return super().result(name, *arguments)


def is_compiler_found() -> bool:
    """Whether costly functions are called in C here."""
    try:
        find_compiler()
    except SoterError:
        return False
    return True


class CompiledQuestions:
    """The system of a checked text (`rest.soter`), compiled."""

    def __init__(self, checked: CheckResult) -> None:
        system = system_of(checked, None)
        unit = generate(system, lower(system))
        self._layout = state_layout(system)
        self._library = Library(library(unit, "-O1"), unit.prefix, self._layout.size)
        self._question, self._was_asked = (
            next(t for t in system.topics if t.name == name) for name in ("question", "was_asked")
        )
        self._node = next(x.index for x in system.components if x.name == "Answering")

    def answer(self, name: str, arguments: Sequence[Any]) -> Any:  # noqa: ANN401 - a value
        """The value that a function of `COMPILED` returns; None if it faults."""
        t, layout, state = self._question.type, self._layout, self._library.new_state(0)
        nothing: Any = self._question.default
        boxes = [(arguments[0], nothing[1][1])] if name == "good" else list(arguments)
        question = bytearray(size_of(t))
        encode_into(question, 0, t, (COMPILED.index(name), *boxes, *nothing[1 + len(boxes) :]))
        at = layout.topic_offset(self._question.index)
        state[at : at + len(question)] = memoryview(question)
        self._library.run_until(state, 0)
        after = state.tobytes()
        if not decode_from(after, layout.topic_offset(self._was_asked.index), self._was_asked.type):
            return None
        led = decode_from(after, *layout.member(self._node, 0))
        return led if name == "keeps" else led[0]
