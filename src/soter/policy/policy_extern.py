"""Makes a learned policy in a file (`onnx:file.onnx`, `sb3:file.zip`) an extern node's step.

Purpose: the numbers of what the node reads go in, in declared order, those of what it publishes
come out; counts are compared before anything runs, and what is assumed is put into words.
Non-goals: what a file says (`onnx_file.py`, `sb3_file.py`), processes and budgets, which are those
of all externs in Python.
"""

from __future__ import annotations

from hashlib import sha256
from math import prod
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.model.types import ArrayType, BoolType, EnumType, FloatType, IntType, RecordType
from soter.native.extern_bindings import FilePolicy
from soter.policy.network import Clipped, numbers_text, prepare_network, standardised_numbers
from soter.policy.onnx_file import onnx_content
from soter.policy.onnx_session import SAY, OnnxSession
from soter.policy.policy_errors import bad_policy_error, read_policy_bytes
from soter.policy.sb3_file import read_sb3
from soter.policy.sb3_statistics import statistics_file_beside
from soter.semantics.externs import Converted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from soter.diagnostics.diagnostic import Span
    from soter.language.load.named_files import BindingText
    from soter.language.model.types import Type, Value
    from soter.policy.network import Standardised

    Shapes = Sequence[tuple[str, Type]]

NUMBERS = (FloatType, IntType, BoolType)
OTHER_START = (
    "where Gymnasium's FrameStackObservation repeats the first, unless its `padding_type` is zero"
)
"""What is told of frames along an axis of their own: either wrapper may have stacked them."""


class PolicyExtern(FilePolicy):
    """A policy that answers an extern node; making it raises SoterError X003, X014, D007.

    `assumed`: facts that are assumed because no file states them.
    """

    def __init__(self, binding: BindingText, reads: Shapes, answers: Shapes) -> None:
        path = Path(binding.file)
        policy = _load_network(binding, path)
        self._run, self._forget = policy.run, policy.forget
        if policy.keys:
            helps = [SAY] if binding.kind == "onnx" else []
            reads = reads_in_order(path, policy.keys, policy.shapes, reads, *helps)
        places = [p for name, t in reads for p in _number_paths(path, name, t)]
        count = sum(n for _, n in places)
        self._get = attrgetter(*(p for p, _ in places)) if places else None
        self._blocks = any(n != 1 for _, n in places)
        self._build = [_value_builder(path, name, t) for name, t in answers]
        self._observation, self.clip = policy.observation, binding.is_clipped
        size = policy.observation.size
        rows = frame_row_count(path, policy.shapes.get("", ()), size, reads)
        frames, self._row = size // count, count // rows
        self._older = size > count
        self._frame = policy.observation.reshape(rows, -1)[:, -self._row :]
        order = ", ".join(p if n == 1 else f"{p} ({n} numbers)" for p, n in places)
        assumed = [f"its observation is {order}", *policy.assumed]
        if frames > 1:
            along = " along the last axis" if rows > 1 else ""
            assumed.append(
                f"{frames} frames are stacked{along}, the oldest first, zeros before the first"
            )
            if len(axes := policy.shapes.get("", ())) > 1 and axes[0] == frames:
                assumed[-1] += f", {OTHER_START}"
        self._per_frame = policy.per_frame
        if self._per_frame is not None and self._per_frame.mean.size != count:
            frame = numbers_text(self._per_frame.mean.size)
            raise bad_policy_error(path, f"a frame of it has {frame}, the node reads {count}")
        self.assumed = tuple(assumed)
        _require_answers(path, policy, answers)

    def reset(self, _seed: int) -> None:
        """Forgets older frames and the network's memory; ignores the seed, as it draws nothing."""
        self._observation[:] = 0.0
        self._forget()

    def step(self, inputs: Any) -> Converted:  # noqa: ANN401 - a namespace of what is read
        """The policy's answer to the inputs of the node."""
        if self._older:
            x = self._observation
            x[: -self._row] = x[self._row :]
        assert self._get is not None
        reads = self._get(inputs)
        frame = np.asarray(_joined_numbers(reads) if self._blocks else reads, self._frame.dtype)
        if self._per_frame is not None:
            frame = standardised_numbers(self._per_frame, frame.astype(np.float64))
        self._frame[...] = frame.reshape(self._frame.shape)
        numbers = iter(self._run())
        return Converted([build(numbers) for build in self._build])


def _joined_numbers(reads: Any) -> npt.NDArray[Any]:  # noqa: ANN401 - numbers and arrays
    parts = reads if isinstance(reads, tuple) else (reads,)
    return np.concatenate([np.ravel(part) for part in parts])


class _LoadedNetwork(NamedTuple):
    """The network of a file, ready to be asked, and how it answers.

    `observation`: where the caller writes what the network observes, (numbers,). `run` gives the
    answer to it, `outputs` numbers; `forget` clears what the network remembers between answers.
    `assumed`: what is assumed as the file does not say it. `whole_numbers`: whether its answers are
    indices. `keys`: of observations by name, each name in order and how many numbers it has.
    `shapes`, `acted`: as in `Policy`. `per_frame`: the layer that scales each frame before frames
    are stacked, if there is one.
    """

    observation: npt.NDArray[Any]
    run: Callable[[], list[float]]
    forget: Callable[[], None]
    outputs: int
    assumed: tuple[str, ...]
    whole_numbers: bool
    keys: tuple[tuple[str, int], ...]
    shapes: Mapping[str, tuple[int, ...]]
    acted: tuple[int, ...] = ()
    per_frame: Standardised | None = None


def _load_network(binding: BindingText, path: Path) -> _LoadedNetwork:
    """The network that a binding names, from an ONNX file or a zip of Stable-Baselines3."""
    if binding.kind == "onnx":
        session = OnnxSession(path, binding.remembered)
        outputs = len(session.run())
        session.reset()
        return _LoadedNetwork(
            observation=session.observation,
            run=session.run,
            forget=session.reset,
            outputs=outputs,
            assumed=session.assumed,
            whole_numbers=session.is_whole,
            keys=session.keys,
            shapes={} if session.keys else {"": session.observation.shape},
            acted=session.shape,
        )
    policy = read_sb3(path, Path(binding.name) if binding.name else None)
    ready = prepare_network(policy.network)
    return _LoadedNetwork(
        observation=ready.observation,
        run=lambda: policy.network.choose_answer(ready.run()),
        forget=ready.reset,
        outputs=policy.network.answer_count,
        assumed=policy.assumed,
        whole_numbers=bool(policy.network.choices),
        keys=policy.keys,
        shapes=policy.shapes,
        acted=policy.acted,
        per_frame=policy.per_frame,
    )


def frame_row_count(path: Path | str, shape: tuple[int, ...], size: int, reads: Shapes) -> int:
    """The number of rows over which each frame of an observation is spread; 1 if in one piece.

    No file says whether `VecFrameStack` stacked along the first or the last axis: the shape of the
    reads decides. `shape` is the observation's, () if it cannot be stacked; `size` is its count of
    numbers. Raises SoterError X014 if the reads are no frame, or fit both ways.
    """
    count = sum(n for name, t in reads for _, n in _number_paths(path, name, t))
    frames, rest = divmod(size, count) if count else (0, 1)
    fits, sizes = not rest and (shape or frames == 1), shape or (size,)
    axes = _axes_of(reads[0][1]) if len(reads) == 1 else []
    rows = {}  # by the shape of a frame
    for axis in {0, len(sizes) - 1} if fits else ():
        frame = [n // frames if k == axis else n for k, n in enumerate(sizes)]
        if sizes[axis] % frames == 0 and (axes == frame or 1 in (len(axes) or 1, len(sizes))):
            rows["".join(f"[{n}]" for n in reversed(frame))] = prod(sizes[:axis])
    if len(rows) == 1:
        return rows.popitem()[1] if frames > 1 else 1
    product = f" ({' x '.join(map(str, sizes))})" if len(sizes) > 1 else ""
    names = ", ".join(f"`{name}`" for name, _ in reads)
    why = f"it takes {numbers_text(size)}{product}, the node reads {count} ({names})"
    help_ = "what a node `subscribes` is its observation, in this order"
    if rows:
        why += f": {frames} frames, along the first axis or the last"
        help_ = f"read one topic in the shape of a frame: `float{'` or `float'.join(rows)}`"
    raise bad_policy_error(path, why, help_)


def _axes_of(t: Type) -> list[int]:
    """The sizes of an array's axes, the outermost first; [] for any other type."""
    return [t.size, *_axes_of(t.element)] if isinstance(t, ArrayType) else []


def reads_in_order(
    path: Path,
    keys: Sequence[tuple[str, int]],
    shapes: Mapping[str, tuple[int, ...]],
    reads: Shapes,
    *helps: str,
) -> Shapes:
    """The node's inputs in the order of the policy's names; raises X014 if they do not fit."""
    known: dict[str, tuple[str, Type]] = {name: (name, t) for name, t in reads}
    name, of = reads[0] if len(reads) == 1 else ("", None)
    if isinstance(of, RecordType):
        known = {field: (f"{name}.{field}", t) for field, t in of.fields}
    if set(known) != {key for key, _ in keys}:
        names = ", ".join(f"`{key}` ({numbers_text(n)})" for key, n in keys)
        why = f"it observes {names} by name, the node reads {', '.join(f'`{n}`' for n in known)}"
        help_ = "name topics like that, or one topic that is a record with these fields"
        raise bad_policy_error(path, why, help_, *helps)
    for key, count in keys:
        read = sum(n for _, n in _number_paths(path, *known[key]))
        if read != count:
            raise bad_policy_error(
                path, f"its `{key}` is {numbers_text(count)}, the node reads {read}"
            )
        frame_row_count(path, shapes.get(key, ()), count, [known[key]])  # in the shape that it has
    return [known[key] for key, _ in keys]


def sha256_of_files(binding: BindingText) -> dict[str, str]:
    """The SHA-256 of each file of a binding, and of files an ONNX file names; raises X003, X014."""
    found = None
    if binding.kind == "sb3" and not binding.name:
        found = statistics_file_beside(Path(binding.file))
    names = (*binding.files, *([str(found)] if found else []))
    hashes = {name: sha256(read_policy_bytes(Path(name))).hexdigest() for name in names}
    if binding.kind == "onnx":
        path = Path(binding.file)
        hashes |= {str(path.parent / n): sha for n, sha in onnx_content(path).beside.items()}
    return hashes


def action_bounds(binding: BindingText) -> list[tuple[float, float]]:
    """The range of each number that a zip's policy can answer; raises X003, X014, D007."""
    statistics = Path(binding.name) if binding.name else None
    network = read_sb3(Path(binding.file), statistics).network
    last = network.layers[-1]
    if isinstance(last, Clipped) and not network.choices:
        low, high = last.decimals
        return list(zip(low.tolist(), high.tolist(), strict=True))
    return [(0.0, n - 1.0) for n in network.choices]


# ---------------------------------------------------------------- numbers in, numbers out


def _number_paths(path: Path | str, name: str, t: Type) -> Iterator[tuple[str, int]]:
    """Yields the attribute path of each number or array of numbers, with its count."""
    if isinstance(t, RecordType):
        for field, of in t.fields:
            yield from _number_paths(path, f"{name}.{field}", of)
    elif isinstance(t, NUMBERS):
        yield name, 1
    elif (count := _array_number_count(t)) > 0:
        yield name, count
    else:
        why = f"`{name}` is a `{t}`, of which no numbers in a fixed order can be given to it"
        raise bad_policy_error(path, why, "bind a class in Python that maps it, with --bind")


def _array_number_count(t: Type) -> int:
    """The count of numbers in an array, with nested arrays; 0 for other types."""
    if isinstance(t, ArrayType):
        return t.size * (1 if isinstance(t.element, NUMBERS) else _array_number_count(t.element))
    return 0


def _value_builder(path: Path, name: str, t: Type) -> Callable[[Iterator[float]], Value]:
    """The function that makes a value of the type from the next numbers of an answer."""
    if isinstance(t, FloatType):
        return lambda numbers: float(next(numbers))
    if isinstance(t, RecordType):
        parts = [_value_builder(path, f"{name}.{f}", of) for f, of in t.fields]
        return lambda numbers: tuple([part(numbers) for part in parts])
    if isinstance(t, ArrayType):
        part = _value_builder(path, name, t.element)
        return lambda numbers: tuple([part(numbers) for _ in range(t.size)])
    if isinstance(t, (IntType, EnumType)):
        low, high = (0, len(t.members) - 1) if isinstance(t, EnumType) else (t.low, t.high)
        return lambda numbers: _checked_index(next(numbers), low, high)
    raise bad_policy_error(path, f"it cannot answer `{name}`, a `{t}`")


def _checked_index(number: float, low: int, high: int) -> int:
    if int(number) != number or not low <= number <= high:
        msg = f"it answers {number}, and its topic takes whole numbers from {low} to {high}"
        raise ValueError(msg)
    return int(number)


def _scalar_types(t: Type) -> Iterator[Type]:
    if isinstance(t, RecordType):
        for _, of in t.fields:
            yield from _scalar_types(of)
    elif isinstance(t, ArrayType):
        yield from list(_scalar_types(t.element)) * t.size
    else:
        yield t


def _require_answers(path: Path, policy: _LoadedNetwork, answers: Shapes) -> None:
    """Raises X014 if the policy's answer does not fit the topics that the node publishes."""
    kinds = [k for _, t in answers for k in _scalar_types(t)]
    names = ", ".join(f"`{name}`" for name, _ in answers)
    if len(kinds) != policy.outputs:
        why = f"it answers {numbers_text(policy.outputs)}, the node publishes "
        raise bad_policy_error(path, f"{why}{len(kinds)} ({names})")
    require_axes(path, policy.acted, answers)
    if not policy.whole_numbers and any(not isinstance(k, FloatType) for k in kinds):
        why = f"it answers numbers with fractions, and {names} takes whole ones"
        raise bad_policy_error(path, why, "a file whose answer is an index (ArgMax) can choose")


def require_axes(path: Path | str, acted: tuple[int, ...], answers: Shapes) -> None:
    """Raises X014 if the axes of the answer differ from the axes of the topic."""
    axes, acted_axes = ([n for n in sizes if n > 1] for sizes in (_axes_of(answers[0][1]), acted))
    if len(answers) == 1 and min(len(axes), len(acted_axes)) > 1 and axes != acted_axes:
        name, shape = answers[0][0], " x ".join(map(str, acted))
        rows = "".join(f"[{n}]" for n in reversed(acted_axes))
        help_ = f"publish `float{rows}`, or `float[{prod(acted_axes)}]` for all in one row"
        raise bad_policy_error(path, f"it answers {shape} numbers, `{name}` has other rows", help_)


def load_policy(
    binding: BindingText, reads: Shapes, answers: Shapes, span: Span | None
) -> PolicyExtern:
    """The policy of a binding; raises SoterError X003, X014, D007 at the node's declaration."""
    try:
        return PolicyExtern(binding, reads, answers)
    except SoterError as error:
        if span is None:
            raise
        label = Label(span, "declared here")
        raise SoterError(
            tuple(
                Diagnostic(d.code, d.message, label, notes=d.notes, helps=d.helps)
                for d in error.diagnostics
            )
        ) from error
