"""A policy in an ONNX file, asked through onnxruntime.

Purpose: one observation in, one answer out, without a copy that is not needed; what does not have
the form of a policy is X014.
Non-goals: what the numbers mean, files that are exported (`onnx_graph.py`).
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.policy.onnx_content import onnx_content
from soter.policy.policy_errors import bad_policy, missing_package

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

DTYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(int64)": np.int64}
NAMES = ("action", "actions")
"""Of several outputs the one that is the answer; else the first is."""


class OnnxSession:
    """A loaded file: `observation` (inputs,) is written, `run()` answers (outputs,).

    SoterError X003, X014; D007 without onnxruntime. `assumed`: what the file does not say.
    """

    def __init__(self, path: Path) -> None:
        data = onnx_content(path).data
        runtime = _onnxruntime()
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            session = runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            why = f"onnxruntime does not load it: {' '.join(str(error).split())[:300]}"
            raise bad_policy(path, why) from error
        inputs, outputs = session.get_inputs(), session.get_outputs()
        self.assumed: tuple[str, ...] = ()
        if len(inputs) != 1 or not outputs:
            names = ", ".join(f"`{x.name}`" for x in inputs[:8])
            why = f"it has {len(inputs)} inputs ({names}) and {len(outputs)} outputs"
            raise bad_policy(path, why, "one input, the observation, and an output are needed")
        named = [x for x in outputs if x.name in NAMES]
        output = (named or outputs)[0]
        if len(outputs) > 1:
            names = ", ".join(f"`{x.name}`" for x in outputs[:8])
            self.assumed = (f"of its outputs {names} `{output.name}` is the answer",)
        shape = tuple(_axis(x) for x in inputs[0].shape)
        if inputs[0].type not in DTYPES or not shape or shape[-1] is None:
            raise bad_policy(path, f"its input is a {inputs[0].type} of shape {inputs[0].shape}")
        if output.type not in DTYPES or any(x not in (None, 1) for x in shape[:-1]):
            why = f"it answers a {output.type} for an input of shape {inputs[0].shape}"
            raise bad_policy(path, why, "one observation is asked at a time: leading axes are 1")
        given = np.zeros([1 if x is None else x for x in shape], DTYPES[inputs[0].type])
        self.observation = given.reshape(-1)
        self._prepare(path, runtime, session, (inputs[0].name, given), output.name)

    def _prepare(
        self,
        path: Path,
        runtime: Any,  # noqa: ANN401 - no types
        session: Any,  # noqa: ANN401
        given: tuple[str, npt.NDArray[Any]],
        answered: str,
    ) -> None:
        """Ask once, and bind input and output to memory that stays."""
        try:
            first = np.asarray(session.run([answered], dict([given]))[0])
        except Exception as error:
            why = f"it cannot be asked: {' '.join(str(error).split())[:300]}"
            raise bad_policy(path, why) from error
        if not first.size or first.ndim > len(given[1].shape) + 1:
            raise bad_policy(path, f"it answers an array of shape {first.shape}")
        out = np.ascontiguousarray(first)
        self.is_whole = out.dtype == np.int64
        self._kept = [runtime.OrtValue.ortvalue_from_numpy(x) for x in (given[1], out)]
        self._binding = session.io_binding()
        self._binding.bind_ortvalue_input(given[0], self._kept[0])
        self._binding.bind_ortvalue_output(answered, self._kept[1])
        self._session, self.answer = session, self._kept[1].numpy().reshape(-1)
        self._out = self._kept[1]

    def run(self) -> list[float]:
        """The numbers that are answered of `observation`; whatever onnxruntime raises."""
        self._session.run_with_iobinding(self._binding)
        answer: list[float] = self._out.numpy().ravel().tolist()
        return answer


def _axis(size: object) -> int | None:
    """A fixed size of an axis; None where the file leaves it open."""
    return size if isinstance(size, int) and size > 0 else None


def _onnxruntime() -> Any:  # noqa: ANN401 - no types
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import onnxruntime  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise missing_package("onnxruntime", "a policy in an ONNX file") from error
    return onnxruntime
