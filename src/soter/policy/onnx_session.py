"""Runs a policy in an ONNX file by onnxruntime.

Purpose: `OnnxSession` takes one observation and gives one answer, without needless copies. Memory
goes in and out: an input that carries it gets at each step the output of the step before, and
zeros at the start of an episode; which output belongs to which input is found by their names
(`h_in` and `h_out`, `h0` and `hn`), or said by the program.
Non-goals: what the operators do (`onnx_file.py` reads some of them).
"""

from __future__ import annotations

import math
import re
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.policy.onnx_file import NAMES, onnx_content
from soter.policy.policy_errors import bad_policy_error, missing_package_error

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import numpy.typing as npt

DTYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(int64)": np.int64}
DIRECTIONS = frozenset(
    {"in", "input", "out", "output", "new", "next", "prev", "previous", "old", "initial", "ins"}
    | {"outs", "inputs", "outputs", "last"}
)
"""Words of a name that say its direction, in or out."""
ENDS = re.compile(r"_?[0nt]$")
"""The ends of names such as `h0`, `hn`, `c_0` and `c_n`."""
NUMBERS_MAX = 1_000_000
SAY = 'say which output is the next value of which input: "onnx:FILE:h0=hn,c0=cn"'


def _name_without_direction(name: str) -> str:
    words = [w for w in re.split(r"[^a-z0-9]+", name.lower()) if w]
    return "_".join(w for w in words if w not in DIRECTIONS)


def _name_without_end(name: str) -> str:
    return ENDS.sub("", _name_without_direction(name))


def memory_pairs(inputs: Sequence[Any], outputs: Sequence[Any]) -> dict[str, str]:
    """For each memory input, by name, the output whose value it gets at the next step.

    An input and an output are a pair if only they have the same shape and the same name without
    words of direction, or else also without an end such as `0` or `n`. The answer is in no pair.
    """
    found: dict[str, str] = {}
    outputs = [y for y in outputs if y.name not in NAMES]
    ways: tuple[Callable[[str], str], ...] = (_name_without_direction, _name_without_end)
    for stem in ways:
        for x in inputs:
            free = [y for y in outputs if y.name not in found.values() and y.name != x.name]
            same = [y for y in free if stem(y.name) == stem(x.name) and _have_one_shape(x, y)]
            rivals = [z for z in inputs if stem(z.name) == stem(x.name)]
            if x.name not in found and len(same) == len(rivals) == 1 and stem(x.name):
                found[x.name] = same[0].name
    return found


def _have_one_shape(x: Any, y: Any) -> bool:  # noqa: ANN401 - no types
    """Whether two values have the same type, and the same size on every axis that both fix."""
    sizes = [[_fixed_size(n) for n in shape] for shape in (x.shape, y.shape)]
    fits = len(sizes[0]) == len(sizes[1]) and all(
        None in pair or pair[0] == pair[1] for pair in zip(*sizes, strict=True)
    )
    return bool(x.type == y.type and fits)


def _declared_pairs(
    path: Path, text: str, inputs: Sequence[Any], outputs: Sequence[Any]
) -> dict[str, str]:
    """The memory pairs that a program declares as `h0=hn,c0=cn`; raises X014 for unknown names."""
    names = [{x.name for x in inputs}, {x.name for x in outputs}]
    pairs = dict(part.split("=") for part in text.split(","))
    for before, after in pairs.items():
        if before not in names[0] or after not in names[1]:
            texts = [", ".join(f"`{n}`" for n in sorted(side)[:8]) for side in names]
            why = f"`{before}={after}`"[:80] + " is no input and output of it"
            raise bad_policy_error(
                path, why, f"its inputs are {texts[0]}, its outputs {texts[1]}", SAY
            )
    return pairs


def _answer_output(path: Path, outputs: Sequence[Any]) -> tuple[Any, tuple[str, ...]]:
    """The output with the answer, and an assumption if several outputs exist."""
    if not outputs:
        raise bad_policy_error(path, "it has no output that is an answer", SAY)
    output = next((x for x in outputs if x.name in NAMES), outputs[0])
    if len(outputs) == 1:
        return output, ()
    names = ", ".join(f"`{x.name}`" for x in outputs[:8])
    return output, (f"of its outputs {names} `{output.name}` is the answer",)


class OnnxSession:
    """A loaded file: the caller writes `observation` (inputs,), and `run()` answers (outputs,).

    `memory`: the pairs that the program declares, or "". `keys`: for several observations, the
    names and counts of numbers, in order. `shape`: the axes of the answer. `assumed`: facts that
    are assumed because the file does not state them. Raises SoterError X003, X014; D007 without
    onnxruntime.
    """

    def __init__(self, path: Path, memory: str = "") -> None:
        session, ort_value = _load_session(path)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        pairs = (
            _declared_pairs(path, memory, inputs, outputs)
            if memory
            else memory_pairs(inputs, outputs)
        )
        seen = [x for x in inputs if x.name not in pairs]
        if not seen:
            raise bad_policy_error(path, "it has no input that is an observation", SAY)
        rest = [x for x in outputs if x.name not in pairs.values() or x.name in NAMES]
        output, self.assumed = _answer_output(path, rest)
        if pairs and not memory:
            text = ", ".join(f"`{x}` is what `{y}` was" for x, y in pairs.items())
            self.assumed += (f"it remembers: {text}, zeros at the start",)
        self.assumed += ("observations are not normalised, unless the file does it",)
        self.observation, zeros = _observation_arrays(path, seen, output)
        many = len(seen) > 1
        self.keys = tuple((x.name, zeros[x.name].size) for x in seen) if many else ()
        kept = {x.name: _zero_memory(path, x) for x in inputs if x.name in pairs}
        first = _first_outputs(path, session, zeros | kept, [output.name, *pairs.values()])
        answer = first[output.name]
        if not answer.size or answer.ndim > max(x.ndim for x in zeros.values()) + 1:
            raise bad_policy_error(path, f"it answers an array of shape {answer.shape}")
        _require_same_shapes(path, pairs, kept, first)
        self.is_whole, self.shape = answer.dtype == np.int64, answer.shape
        values = {name: ort_value(array) for name, array in (zeros | kept).items()}
        out = {name: ort_value(np.ascontiguousarray(array)) for name, array in first.items()}
        self._binding = session.io_binding()
        for name, value in values.items():
            self._binding.bind_ortvalue_input(name, value)
        for name, value in out.items():
            self._binding.bind_ortvalue_output(name, value)
        self._session, self._out = session, out[output.name]
        self._inputs = values  # keeps the bound memory alive
        self._memory = [(array, out[pairs[name]]) for name, array in kept.items()]

    def run(self) -> list[float]:
        """The answer to `observation`; passes on errors of onnxruntime."""
        self._session.run_with_iobinding(self._binding)
        for kept, after in self._memory:
            kept[...] = after.numpy()
        answer: list[float] = self._out.numpy().ravel().tolist()
        return answer

    def reset(self) -> None:
        """Begins an episode: sets all memory to zeros."""
        for kept, _ in self._memory:
            kept[...] = 0


def _load_session(path: Path) -> tuple[Any, Callable[[npt.NDArray[Any]], Any]]:
    """The session, and the function that makes onnxruntime's value share an array's memory."""
    data = onnx_content(path).data
    runtime = _import_onnxruntime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        why = f"onnxruntime does not load it: {' '.join(str(error).split())[:300]}"
        raise bad_policy_error(path, why) from error
    return session, runtime.OrtValue.ortvalue_from_numpy


def _observation_arrays(
    path: Path,
    seen: Sequence[Any],
    output: Any,  # noqa: ANN401 - no types
) -> tuple[npt.NDArray[Any], dict[str, npt.NDArray[Any]]]:
    """All numbers of observations, (inputs,), and by name the arrays that are views of them."""
    shapes = [tuple(_fixed_size(n) for n in x.shape) for x in seen]
    for x, shape in zip(seen, shapes, strict=True):
        if x.type not in DTYPES or not shape or shape[-1] is None:
            raise bad_policy_error(path, f"its input `{x.name}` is a {x.type} of shape {x.shape}")
        if output.type not in DTYPES or any(n not in (None, 1) for n in shape[:-1]):
            why = f"it answers a {output.type} for an input of shape {x.shape}"
            raise bad_policy_error(
                path, why, "one observation is asked at a time: leading axes are 1"
            )
    if len({x.type for x in seen}) > 1:
        types = ", ".join(f"`{x.name}` {x.type}" for x in seen)
        raise bad_policy_error(path, f"its inputs have other types: {types}", SAY)
    sizes = [int(shape[-1] or 0) for shape in shapes]
    if sum(sizes) > NUMBERS_MAX:
        raise bad_policy_error(path, f"it observes {sum(sizes)} numbers, more than are read")
    numbers = np.zeros(sum(sizes), DTYPES[seen[0].type])
    parts = np.split(numbers, np.cumsum(sizes)[:-1])
    return numbers, {
        x.name: part.reshape([n or 1 for n in shape])
        for x, part, shape in zip(seen, parts, shapes, strict=True)
    }


def _zero_memory(path: Path, x: Any) -> npt.NDArray[Any]:  # noqa: ANN401
    """The memory at the start of an episode: zeros in the shape of an input."""
    if x.type not in DTYPES or math.prod(_fixed_size(n) or 1 for n in x.shape) > NUMBERS_MAX:
        raise bad_policy_error(
            path, f"what it remembers, `{x.name}`, is a {x.type} of shape {x.shape}"
        )
    return np.zeros([_fixed_size(n) or 1 for n in x.shape], DTYPES[x.type])


def _first_outputs(
    path: Path,
    session: Any,  # noqa: ANN401 - no types
    inputs: dict[str, npt.NDArray[Any]],
    names: list[str],
) -> dict[str, npt.NDArray[Any]]:
    """The outputs for these inputs, by name; raises X014 if the graph cannot be run."""
    once = list(dict.fromkeys(names))
    try:
        answers = session.run(once, inputs)
        return {name: np.asarray(x) for name, x in zip(once, answers, strict=True)}
    except Exception as error:
        why = f"it cannot be asked: {' '.join(str(error).split())[:300]}"
        raise bad_policy_error(path, why) from error


def _require_same_shapes(
    path: Path,
    pairs: dict[str, str],
    kept: dict[str, npt.NDArray[Any]],
    first: dict[str, npt.NDArray[Any]],
) -> None:
    """Raises X014 if an output has another shape or type than its memory input."""
    for name, array in kept.items():
        after = first[pairs[name]]
        if array.shape != after.shape or array.dtype != after.dtype:
            why = f"`{name}` has the shape {array.shape}, `{pairs[name]}` {after.shape}"
            raise bad_policy_error(path, why, SAY)


def _fixed_size(size: object) -> int | None:
    """The size of an axis; None if the file leaves it open."""
    return size if isinstance(size, int) and size > 0 else None


def _import_onnxruntime() -> Any:  # noqa: ANN401 - no types
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import onnxruntime  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise missing_package_error("onnxruntime", "a policy in an ONNX file") from error
    return onnxruntime
