"""Runs an extern node in Python in its own process, in virtual or in real time.

Purpose: for `soter run`, a `ProcessExtern` asks a child process for every step. The child
(`VirtualTimeResponder`) loads the user's code, calls it and converts its answer to text of limited
length, which is checked here: so every failure in the child is a step fault and no more. It is
started again up to `RESTARTS` times. For a run in real time `simulate/real_time.py` starts this
file as a module with the path of a spec, which `write_spec` has written: `main` answers with a
`RealTimeResponder` until the driver is gone.
Non-goals: lateness and wrong answers, which driver and gate handle; extern plants and functions,
which stay in the process of the engine.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.core.layout import decode_from, encode_into
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.language.model.values import inputs_to_python
from soter.native.extern_bindings import policy_files
from soter.report.wording import visible
from soter.semantics.externs import Converted, convert_answer
from soter.simulate.externs.python_answers import PlainError, failure_text
from soter.simulate.externs.python_extern import (
    Answered,
    PythonExtern,
    clip_target,
    load_python,
    node_answers,
)
from soter.simulate.interrupt import StopRequest
from soter.workers.child_process import Child, DeadError
from soter.workers.exchange import Channel, Exchange, LayoutError, make_exchange

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type, Value

    Shapes = Sequence[tuple[str, Type]]


EXIT_LAYOUT, EXIT_LOAD = 3, 4


@dataclass(frozen=True)
class Spec:
    """The facts about a node that its process needs; `binding` has absolute paths."""

    name: str
    binding: str
    exchange: Exchange
    seed: int
    shapes: tuple[tuple[str, Type], ...]
    answers: tuple[Answered, ...]


def write_spec(system: System, component: Component, seed: int, path: Path) -> None:
    """Writes the spec of an extern node that is bound to Python or to a policy."""
    binding = binding_of(component.binding)
    assert component.node is not None
    assert binding is not None
    absolute = str(binding.in_folder(Path.cwd()))
    shapes = tuple(component.node.answers)
    exchange, answers = make_exchange(system, component), node_answers(system, component)
    spec = Spec(component.name, absolute, exchange, seed, shapes, answers)
    path.write_bytes(pickle.dumps(spec))


class RealTimeResponder:
    """Answers requests to a node in a real-time run; an `Exchange` defines both byte layouts."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        target = clip_target(_load_target(spec), spec.answers)
        self._extern = PythonExtern(spec.name, target, StopRequest(), spec.shapes)
        self._extern.reset(spec.seed)
        self._reported = False

    def step(self, data: bytes) -> bytes | None:
        """The answer to a request; None if the step failed. It prints the first failure."""
        try:
            return self._encode_answer(self._extern.step(self._decode_inputs(data)))
        except Exception as error:  # noqa: BLE001 - whatever an extern does is its fault
            if not self._reported:
                print(f"{self._spec.name}: {failure_text(error)}", file=sys.stderr, flush=True)
            self._reported = True
            return None

    def _decode_inputs(self, data: bytes) -> Any:  # noqa: ANN401 - a namespace of any values
        members = sorted(self._spec.exchange.request.members, key=lambda m: m.index)
        return inputs_to_python(
            [(m.name, m.type, decode_from(data, m.offset, m.type)) for m in members]
        )

    def _encode_answer(self, answer: object) -> bytes:
        values = convert_answer(self._spec.shapes, answer)
        sent = {n: v for (n, _), v in zip(self._spec.shapes, values, strict=True) if v is not None}
        present: dict[str, Any] = {f"has_{n}": n in sent for n, _ in self._spec.shapes}
        layout = self._spec.exchange.answer
        out = bytearray(layout.size)
        for member in layout.members:
            if member.name in (fields := {**sent, **present}):
                encode_into(out, member.offset, member.type, fields[member.name])
        return bytes(out)


def _load_target(spec: Spec) -> object:
    """Loads the object that the binding names; raises the `SoterError` of a failed load."""
    binding = binding_of(spec.binding)
    if binding is None or not binding.is_policy:
        return load_python(spec.binding, None)
    members = sorted(spec.exchange.request.members, key=lambda m: m.index)
    reads = [(m.name, m.type) for m in members]
    return policy_files().load_policy(binding, reads, spec.shapes, None)


class _LossyStderr(io.FileIO):
    """A standard error stream that never waits for its reader and drops text that has no room."""

    def write(self, data: Any) -> int:  # noqa: ANN401 - bytes of any kind
        with suppress(OSError):
            super().write(data)
        return len(data)


def main(path: str) -> int:
    """Answers requests until the process is ended; gives an exit status if it cannot."""
    words = io.TextIOWrapper(_LossyStderr(2, "w"), errors="backslashreplace", line_buffering=True)
    sys.stdout = sys.stderr = sys.__stdout__ = sys.__stderr__ = words  # type: ignore[misc]
    spec: Spec = pickle.loads(Path(path).read_bytes())  # noqa: S301 - soter wrote it
    channel = Channel(spec.exchange.number, spec.exchange.sizes)
    try:
        server = RealTimeResponder(spec)
    except SoterError as error:
        return _report_failure(spec, "; ".join(d.message for d in error.diagnostics))
    except Exception as error:  # noqa: BLE001 - of the person's `reset`
        return _report_failure(spec, f"it could not be reset: {failure_text(error)}")
    channel.announce_ready()
    try:
        while True:
            request = channel.next_request()
            channel.answer(request, server.step(request.data))
    except LayoutError:
        print(f"{spec.name}: asked in another layout", file=sys.stderr, flush=True)
        return EXIT_LAYOUT


def _report_failure(spec: Spec, why: str) -> int:
    print(f"{spec.name}: {why}", file=sys.stderr, flush=True)
    return EXIT_LOAD


PATIENCE = "SOTER_EXTERN_PATIENCE_S"
PATIENCE_S = 60.0
"""How long one step may take, in s of the clock, unless $SOTER_EXTERN_PATIENCE_S is set."""
RESTARTS = 5
TEXT_MAX = 2000
LOADING: tuple[Code, ...] = ("X003", "X002", "X014", "D007")
"""The codes of errors that loading may report; the first stands for all others."""


class GoneError(PlainError):
    """Raised if the process of an extern gives no answer."""


class ForgedError(PlainError):
    """Raised if the process of an extern sends an answer that its code cannot have computed."""


class ProcessExtern:
    """An extern in a separate process, with `step`, and with `reset(seed)` before every run."""

    def __init__(
        self, name: str, load: Callable[[], object], shapes: Shapes, span: Span, stop: StopRequest
    ) -> None:
        """Starts the child, in which `load()` makes the user's object; raises its `SoterError`."""
        self._name, self._load, self._shapes, self._span = name, load, tuple(shapes), span
        self._stop = stop
        self._seed: int | None = None
        self._restarts_left = RESTARTS
        self._patience_s = _step_patience_s()
        self.assumed: tuple[str, ...] = ()
        self._child: Child | None = self._start_child()

    def step(self, inputs: object) -> object:
        """Makes a step; raises `GoneError`, `ForgedError`, or `PlainError` if the extern failed."""
        if self._child is None:
            self._child = self._restart_child()
        reply = self._ask_child(self._child, b"s" + pickle.dumps(inputs), self._patience_s)
        values = reply.get("values")
        if not isinstance(values, list) or len(values) != len(self._shapes):
            raise ForgedError("its process answered nothing that is an answer")
        return Converted(
            None if v is None else checked_value(t, v)
            for (_, t), v in zip(self._shapes, values, strict=True)
        )

    def reset(self, seed: int) -> None:
        """Calls the object's `reset` if it exists; raises the same errors as `step`."""
        self._seed = seed
        self._restarts_left = RESTARTS
        if self._child is None:
            self._child = self._start_child()
        self._ask_child(self._child, b"r%d" % seed, None)

    def close(self) -> None:
        """Ends the process; the next `reset` starts a new process."""
        if self._child is not None:
            self._child.end()
        self._child = None

    def _start_child(self) -> Child:
        shapes, load, name = self._shapes, self._load, self._name
        child = Child(lambda: VirtualTimeResponder(name, load, shapes).answer)
        try:
            reply = self._ask_child(child, b"l", None)
        except GoneError as error:
            text = f"extern `{self._name}` cannot be loaded: {error}"
            label = Label(self._span, "its process ended while this was loaded")
            raise SoterError((Diagnostic("X003", text, label),)) from error
        problems = reply.get("problems")
        if problems:
            child.end("told")
            raise SoterError(tuple(_diagnostic_of_child(p, self._span) for p in problems))
        assumed = reply.get("assumed")
        texts = assumed if isinstance(assumed, list) else []
        self.assumed = tuple([visible(str(x)[:TEXT_MAX]) for x in texts[:8]])
        return child

    def _restart_child(self) -> Child:
        if self._restarts_left == 0:
            raise GoneError(f"its process is gone, and was started {RESTARTS} times again")
        self._restarts_left -= 1
        try:
            child = self._start_child()
        except SoterError as error:
            raise GoneError(error.diagnostics[0].message) from error
        if self._seed is not None:
            self._ask_child(child, b"r%d" % self._seed, None)
        return child

    def _ask_child(self, child: Child, question: bytes, patience_s: float | None) -> dict[str, Any]:
        """Asks the child and gives its answer; a child that sends anything else counts as gone."""
        self._stop.in_extern = True
        try:
            reply = child.answer_to(question, patience_s)
        except DeadError as error:
            self._child = None
            raise GoneError(str(error)) from error
        finally:
            self._stop.in_extern = False
        try:
            answer = json.loads(reply)
        except (ValueError, RecursionError) as error:
            raise ForgedError("its process answered nothing that is an answer") from error
        if not isinstance(answer, dict):
            raise ForgedError("its process answered nothing that is an answer")
        if "failed" in answer:
            raise PlainError(str(answer["failed"])[:TEXT_MAX])
        return answer


def _step_patience_s() -> float:
    try:
        return max(float(os.environ.get(PATIENCE, "")), 0.001)
    except ValueError:
        return PATIENCE_S


def _diagnostic_of_child(data: object, span: Span) -> Diagnostic:
    fields: dict[str, Any] = data if isinstance(data, dict) else {}
    code = next((code for code in LOADING if code == fields.get("code")), LOADING[0])
    lines = [[str(x)[:TEXT_MAX] for x in fields.get(k) or ()][:8] for k in ("notes", "helps")]
    return Diagnostic(
        code,
        visible(str(fields.get("message", "it cannot be loaded"))[:TEXT_MAX]),
        Label(span, "declared here") if fields.get("placed") else None,
        notes=tuple(map(visible, lines[0])),
        helps=tuple(map(visible, lines[1])),
    )


def checked_value(t: Type, data: Any) -> Value:  # noqa: ANN401 - anything at all
    """A value that was read from JSON; raises `ForgedError` if it is not of type `t`."""
    if isinstance(t, BoolType):
        fits = isinstance(data, bool)
    elif isinstance(t, FloatType):
        fits = isinstance(data, float)
    elif isinstance(t, IntType):
        fits = type(data) is int and t.low <= data <= t.high
    elif isinstance(t, DurationType):
        fits = type(data) is int and -(2**63) <= data < 2**63
    elif isinstance(t, EnumType):
        fits = type(data) is int and 0 <= data < len(t.members)
    else:
        return _checked_parts(t, data)
    if not fits:
        raise ForgedError("its process answered a value of another type")
    return data


def _checked_parts(t: Type, data: Any) -> Value:  # noqa: ANN401 - anything at all
    if isinstance(data, list):
        if isinstance(t, RecordType) and len(data) == len(t.fields):
            return tuple(checked_value(f, v) for (_, f), v in zip(t.fields, data, strict=True))
        if isinstance(t, ArrayType) and len(data) == t.size:
            return tuple(checked_value(t.element, v) for v in data)
        if isinstance(t, ListType) and len(data) <= t.capacity:
            return tuple(checked_value(t.element, v) for v in data)
    raise ForgedError("its process answered a value of another type")


# ---------------------------------------------------------------- the child


class VirtualTimeResponder:
    """Answers the questions to a node in a `ProcessExtern`'s child: a letter, data; JSON back."""

    def __init__(self, name: str, load: Callable[[], object], shapes: Shapes) -> None:
        self._name, self._load, self._shapes = name, load, shapes
        self._extern: PythonExtern | None = None

    def answer(self, question: bytes) -> bytes:
        """Answers the question `l` (load), `r` (reset, then a seed) or `s` (step, then inputs)."""
        try:
            reply = self._reply(question[:1], question[1:])
        except SoterError as error:
            reply = {"problems": [_diagnostic_document(d) for d in error.diagnostics]}
        except Exception as error:  # noqa: BLE001 - whatever an extern does is its fault
            reply = {"failed": failure_text(error)}
        return json.dumps(reply).encode()

    def _reply(self, question: bytes, rest: bytes) -> dict[str, Any]:
        if question == b"l":
            self._extern = PythonExtern(self._name, self._load(), StopRequest(), self._shapes)
            return {"assumed": list(self._extern.assumed)}
        assert self._extern is not None
        if question == b"r":
            self._extern.reset(int(rest))
            return {}
        inputs = pickle.loads(rest)  # noqa: S301 - our own parent's
        return {"values": list(convert_answer(self._shapes, self._extern.step(inputs)))}


def _diagnostic_document(d: Diagnostic) -> dict[str, Any]:
    return {
        "code": d.code,
        "message": d.message,
        "placed": d.primary is not None,
        "notes": list(d.notes),
        "helps": list(d.helps),
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
