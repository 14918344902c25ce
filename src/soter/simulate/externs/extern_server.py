"""The process of an extern node in Python.

Purpose: run as a module with SPEC (`native/compiler.py`) it loads the person's code and answers
what the driver asks, until the driver is gone. SPEC says what and how: `write_spec` writes it.
Non-goals: being on time or right: the driver and the gate see to that.
"""

from __future__ import annotations

import pickle
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.core.layout import decode_from, encode_into
from soter.diagnostics.diagnostic import SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.values import inputs_to_python
from soter.semantics.externs import converted
from soter.simulate.externs.python_answers import described
from soter.simulate.externs.python_extern import (
    Answered,
    PythonExtern,
    answered,
    clipping,
    load_python,
    policy_files,
)
from soter.simulate.interrupt import StopRequest
from soter.workers.exchange_layout import Exchange, exchange_of
from soter.workers.shared_memory_channel import Channel, LayoutError

if TYPE_CHECKING:
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type

EXIT_LAYOUT, EXIT_LOAD = 3, 4


@dataclass(frozen=True)
class Spec:
    """What a worker has to know of its node; `binding`: its text, with absolute files."""

    name: str
    binding: str
    exchange: Exchange
    seed: int
    shapes: tuple[tuple[str, Type], ...]
    answers: tuple[Answered, ...]


def write_spec(system: System, component: Component, seed: int, path: Path) -> None:
    """Write the spec of an extern node that is bound to Python, or to a policy."""
    binding = binding_of(component.binding)
    assert component.node is not None
    assert binding is not None
    absolute = str(binding.beside(Path.cwd()))
    shapes = tuple(component.node.answers)
    exchange, answers = exchange_of(system, component), answered(system, component)
    spec = Spec(component.name, absolute, exchange, seed, shapes, answers)
    path.write_bytes(pickle.dumps(spec))


class ExternServer:
    """One node, its code loaded, before its first request."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        target = clipping(_loaded(spec), spec.answers)
        self._extern = PythonExtern(spec.name, target, StopRequest(), spec.shapes)
        self._extern.reset(spec.seed)
        self._said = False

    def step(self, data: bytes) -> bytes | None:
        """The answer to a request; None where the step failed. The first failure is said."""
        try:
            return self._encoded(self._extern.step(self._inputs(data)))
        except Exception as error:  # noqa: BLE001 - whatever an extern does is its fault
            if not self._said:
                print(f"{self._spec.name}: {described(error)}", file=sys.stderr, flush=True)
            self._said = True
            return None

    def _inputs(self, data: bytes) -> Any:  # noqa: ANN401 - a namespace of any values
        members = sorted(self._spec.exchange.request.members, key=lambda m: m.index)
        return inputs_to_python(
            [(m.name, m.type, decode_from(data, m.offset, m.type)) for m in members]
        )

    def _encoded(self, answer: object) -> bytes:
        values = converted(self._spec.shapes, answer)
        given = {n: v for (n, _), v in zip(self._spec.shapes, values, strict=True) if v is not None}
        present: dict[str, Any] = {f"has_{n}": n in given for n, _ in self._spec.shapes}
        layout = self._spec.exchange.answer
        out = bytearray(layout.size)
        for member in layout.members:
            if member.name in (fields := {**given, **present}):
                encode_into(out, member.offset, member.type, fields[member.name])
        return bytes(out)


def _loaded(spec: Spec) -> object:
    """The object that the binding names; SoterError as loading raises it."""
    binding = binding_of(spec.binding)
    if binding is None or not binding.is_policy:
        return load_python(spec.binding, None)
    members = sorted(spec.exchange.request.members, key=lambda m: m.index)
    reads = [(m.name, m.type) for m in members]
    return policy_files().load_policy(binding, reads, spec.shapes, None)


def main(path: str) -> int:
    """Answer until the process is ended."""
    spec: Spec = pickle.loads(Path(path).read_bytes())  # noqa: S301 - soter wrote it
    channel = Channel(spec.exchange.number, spec.exchange.sizes)
    try:
        server = ExternServer(spec)
    except SoterError as error:
        return _not_loaded(spec, "; ".join(d.message for d in error.diagnostics))
    except Exception as error:  # noqa: BLE001 - of the person's `reset`
        return _not_loaded(spec, f"it could not be reset: {described(error)}")
    channel.ready()
    try:
        while True:
            request = channel.next()
            channel.answer(request, server.step(request.data))
    except LayoutError:
        print(f"{spec.name}: asked in another layout", file=sys.stderr, flush=True)
        return EXIT_LAYOUT


def _not_loaded(spec: Spec, why: str) -> int:
    print(f"{spec.name}: {why}", file=sys.stderr, flush=True)
    return EXIT_LOAD


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
