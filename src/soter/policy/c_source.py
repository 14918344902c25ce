"""Writes a network as C that answers an extern node, for campaigns, packages and boards.

Purpose: `c_source` writes a file to bind with `c:FILE:FUNCTION`. Layers are computed in float32 as
`network.py` does, sums in double, so that the answer is that of the policy's file within rounding;
memory and stacked frames are static variables.
Non-goals: a bound on the difference (`soter_source.py` has one); graphs that are no layers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.codegen.c_names import field_name
from soter.language.model.types import ArrayType, BoolType, EnumType, FloatType, IntType, RecordType
from soter.policy.network import (
    Activation,
    Affine,
    Clipped,
    Elementwise,
    Lstm,
    OneHot,
    Relu,
    Standardised,
)
from soter.policy.policy_errors import bad_policy_error
from soter.policy.policy_extern import frame_row_count, require_axes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.language.model.types import Type
    from soter.policy.network import Layer, Policy

    Shapes = Sequence[tuple[str, Type]]

SIGMOID = "0.5 + 0.5 * tanh(0.5 * x)"
SOFTPLUS = "fmax(x, 0.0) + log1p(exp(-fabs(x)))"
ELU = "(x > 0.0 ? x : expm1(x))"
ACTIVATIONS = {
    "ELU": ELU,
    "GELU": "0.5 * x * (1.0 + erf(x / 1.4142135623730951))",
    "LeakyReLU": "(x > 0.0 ? x : 0.01 * x)",
    "Mish": f"x * tanh({SOFTPLUS})",
    "ReLU6": "fmin(fmax(x, 0.0), 6.0)",
    "SELU": f"1.0507009873554805 * (x > 0.0 ? x : 1.6732632423543772 * {ELU})",
    "SiLU": f"x * ({SIGMOID})",
    "Sigmoid": SIGMOID,
    "Softplus": SOFTPLUS,
    "Softsign": "x / (1.0 + fabs(x))",
}
COLUMNS = 12


def c_source(
    policy: Policy, function: str, name: str, header: str, reads: Shapes, writes: Shapes
) -> str:
    """The C source of a policy that answers an extern node.

    `function` is the name of the C function, `name` the prefix of the node's C names
    (`rush_Learned`), `header` the program's header. `reads` and `writes` are topics in the order of
    the policy's numbers. Raises SoterError X014 if the policy has another count of numbers.
    """
    network = policy.network
    places = [place for n, t in reads for place, _ in _number_places(f"in->{_member_name(n)}", t)]
    lines = [f'#include "{header}"', "#include <math.h>", "#include <string.h>", ""]
    lines += [f"int {function}(const {name}_in *in, {name}_out *out);", ""]
    rows = frame_row_count(policy.path, policy.shapes.get("", ()), network.inputs, reads)
    body = _observation_code(policy, places, rows)
    size, at = network.inputs, "x0"
    for number, layer in enumerate(network.layers, 1):
        constants, steps = _layer_code(layer, number, size, at)
        lines += constants
        body += steps
        size, at = _output_count(layer, size), f"x{number}"
    body += _answer_code(policy, writes, size, at)
    statics = list(_static_variables(policy, len(places)))
    head = f"int {function}(const {name}_in *in, {name}_out *out) {{"
    return "\n".join([*lines, *statics, head, *(f"  {line}" for line in body), "}"]) + "\n"


def _member_name(name: str) -> str:
    """The C name of a member, or of a member's member: `pose`, `pose.x`."""
    return ".".join(field_name(part) for part in name.split("."))


def _static_variables(policy: Policy, frame: int) -> Iterator[str]:
    """Yields the declarations of variables that last from step to step."""
    if policy.network.inputs > frame:
        yield f"static float x0[{policy.network.inputs}];"
    for number, layer in enumerate(policy.network.layers, 1):
        if isinstance(layer, Lstm):
            yield f"static float x{number}[{layer.outputs}], kept{number}[{layer.outputs}];"
    yield ""


def _observation_code(policy: Policy, sources: Sequence[str], rows: int) -> list[str]:
    """The C that makes the observation: older frames move down, a new one is read."""
    inputs, frame, row = policy.network.inputs, len(sources), len(sources) // rows
    places = np.arange(inputs).reshape(rows, -1)[:, -row:].ravel().tolist()
    lines = [f"float x0[{inputs}];"]
    if inputs > frame:
        lines = [f"memmove(x0, x0 + {row}, {inputs - row} * sizeof x0[0]);"]
    lines += [f"x0[{k}] = (float){place};" for k, place in zip(places, sources, strict=True)]
    if (scale := policy.per_frame) is not None:
        lines += [*_c_table("MEAN", scale.mean), *_c_table("DEVIATION", scale.deviation)]
        lines += _c_table("LIMIT", scale.limit)
        at = f"x0[i / {row} * {inputs // rows} + {inputs // rows - row} + i % {row}]"
        clipped = f"fmin(fmax(({at} - MEAN[i]) / DEVIATION[i], -LIMIT[i]), LIMIT[i])"
        lines.append(f"for (int i = 0; i < {frame}; i++) {at} = (float)({clipped});")
    return lines


def _output_count(layer: Layer, size: int) -> int:
    if isinstance(layer, (OneHot, Lstm)):
        return layer.outputs
    return len(layer.bias) if isinstance(layer, Affine) else size


def _layer_code(layer: Layer, number: int, size: int, at: str) -> tuple[list[str], list[str]]:
    """Constants and statements that compute `x{number}` from `at`, which has `size` numbers."""
    here, name = f"x{number}", f"L{number}"
    if isinstance(layer, Lstm):
        return _lstm_code(layer, number, size, at)
    if isinstance(layer, OneHot):
        return [], [f"float {here}[{layer.outputs}];", *_one_hot_code(layer, here, at)]
    if isinstance(layer, Affine):
        rows = len(layer.bias)
        constants = [*_c_table(f"{name}_W", layer.weight), *_c_table(f"{name}_B", layer.bias)]
        return constants, [
            f"float {here}[{rows}];",
            f"for (int i = 0; i < {rows}; i++) {{",
            f"  double sum = {name}_B[i];",
            f"  for (int j = 0; j < {size}; j++) sum += (double){name}_W[i][j] * (double){at}[j];",
            f"  {here}[i] = (float)sum;",
            "}",
        ]
    constants, value = _elementwise_code(layer, name)
    return constants, [
        f"float {here}[{size}];",
        f"for (int i = 0; i < {size}; i++) {{",
        f"  double x = (double){at}[i];",
        f"  {here}[i] = (float)({value});",
        "}",
    ]


def _elementwise_code(layer: Layer, prefix: str) -> tuple[list[str], str]:
    """The constants of a layer, and the C expression of its result for one number `x`."""
    if isinstance(layer, Standardised):
        parts = {"MEAN": layer.mean, "DEVIATION": layer.deviation, "LIMIT": layer.limit}
        constants = [line for n, a in parts.items() for line in _c_table(f"{prefix}_{n}", a)]
        scaled = f"(x - {prefix}_MEAN[i]) / {prefix}_DEVIATION[i]"
        return constants, f"fmin(fmax({scaled}, -{prefix}_LIMIT[i]), {prefix}_LIMIT[i])"
    if isinstance(layer, Elementwise):
        value = f"x {layer.operation} (double){prefix}_BY[i]"
        return _c_table(f"{prefix}_BY", layer.operand), value
    if isinstance(layer, Clipped):
        constants = [*_c_table(f"{prefix}_LOW", layer.low), *_c_table(f"{prefix}_HIGH", layer.high)]
        return constants, f"fmin(fmax(x, (double){prefix}_LOW[i]), (double){prefix}_HIGH[i])"
    if isinstance(layer, Activation):
        return [], ACTIVATIONS[layer.name]
    return [], "fmax(x, 0.0)" if isinstance(layer, Relu) else "tanh(x)"


def _one_hot_code(layer: OneHot, here: str, at: str) -> Iterator[str]:
    yield f"memset({here}, 0, sizeof {here});"
    place = 0
    for k, size in enumerate(layer.sizes):
        if not size:
            yield f"{here}[{place}] = {at}[{k}];"
        else:
            yield f"if (!({at}[{k}] >= 0.0f && {at}[{k}] < {size}.0f)) return 1;"
            yield f"if ({at}[{k}] != (float)(int){at}[{k}]) return 1;"
            yield f"{here}[{place} + (int){at}[{k}]] = 1.0f;"
        place += size or 1


def _lstm_code(layer: Lstm, number: int, size: int, at: str) -> tuple[list[str], list[str]]:
    """Constants and statements of an LSTM, whose gates read its input and its last answer."""
    here, prefix, kept, n = f"x{number}", f"L{number}", f"kept{number}", layer.outputs
    constants = [*_c_table(f"{prefix}_W", layer.weight), *_c_table(f"{prefix}_B", layer.bias)]
    gates = [SIGMOID.replace("x", f"g{number}[{k} * {n} + i]") for k in (0, 1, 3)]
    new = f"tanh(g{number}[2 * {n} + i])"
    return constants, [
        f"double g{number}[{4 * n}];",
        f"for (int i = 0; i < {4 * n}; i++) {{",
        f"  g{number}[i] = {prefix}_B[i];",
        f"  for (int j = 0; j < {size}; j++)",
        f"    g{number}[i] += (double){prefix}_W[i][j] * (double){at}[j];",
        f"  for (int j = 0; j < {n}; j++)",
        f"    g{number}[i] += (double){prefix}_W[i][{size} + j] * (double){here}[j];",
        "}",
        f"for (int i = 0; i < {n}; i++) {{",
        f"  {kept}[i] = (float)(({gates[1]}) * (double){kept}[i] + ({gates[0]}) * {new});",
        f"  {here}[i] = (float)(({gates[2]}) * tanh((double){kept}[i]));",
        "}",
    ]


def _answer_code(policy: Policy, writes: Shapes, size: int, at: str) -> Iterator[str]:
    """Yields the statements that write the node's outputs, number by number."""
    network = policy.network
    places = [(p, k) for n, t in writes for p, k in _number_places(f"out->{field_name(n)}", t)]
    if len(places) != network.answer_count:
        why = f"it answers {network.answer_count} numbers, the node publishes {len(places)}"
        raise bad_policy_error(policy.path, why)
    require_axes(policy.path, policy.acted, writes)
    start = 0
    for k, (place, kind) in enumerate(places):
        if isinstance(kind, FloatType) != (not network.choices):
            raise bad_policy_error(policy.path, f"it cannot answer `{place}`, a `{kind}`")
        if not network.choices:
            yield f"{place} = (double){at}[{k}];"
            continue
        count = network.choices[k]
        yield f"int best{k} = 0;"
        yield (
            f"for (int i = 1; i < {count}; i++) "
            f"if ({at}[{start} + i] > {at}[{start} + best{k}]) best{k} = i;"
        )
        if isinstance(kind, IntType):
            yield f"if (best{k} < {kind.low} || best{k} > {kind.high}) return 1;"
        yield f"{place} = best{k};"
        start += count
    assert not network.choices or start == size
    for n, _ in writes:
        yield f"out->{field_name('has_' + n)} = 1;"
    yield "return 0;"


def _number_places(at: str, t: Type) -> Iterator[tuple[str, Type]]:
    """Yields the C expression and the type of each number of a value."""
    if isinstance(t, RecordType):
        for field, of in t.fields:
            yield from _number_places(f"{at}.{field_name(field)}", of)
    elif isinstance(t, ArrayType):
        for k in range(t.size):
            yield from _number_places(f"{at}.at[{k}]", t.element)
    else:
        assert isinstance(t, (FloatType, IntType, EnumType, BoolType))
        yield at, t


def _c_number(value: float, *, single: bool) -> str:
    """A number as a C literal, exact to the last bit."""
    if not np.isfinite(value):
        return "-INFINITY" if value < 0.0 else "INFINITY"
    return f"{float(value).hex()}{'f' if single else ''}"


def _c_table(name: str, array: npt.NDArray[np.floating]) -> list[str]:
    """The lines of a constant vector or matrix."""
    single = array.dtype == np.float32
    axes = "".join(f"[{n}]" for n in array.shape)
    lines = [f"static const {'float' if single else 'double'} {name}{axes} = {{"]
    for row in array if array.ndim == 2 else array[None]:
        inner = list(_table_lines([_c_number(x, single=single) for x in row.tolist()]))
        lines += ["  {", *inner, "  },"] if array.ndim == 2 else inner
    return [*lines, "};"]


def _table_lines(words: Sequence[str]) -> Iterable[str]:
    for k in range(0, len(words), COLUMNS):
        yield "    " + " ".join(f"{w}," for w in words[k : k + COLUMNS])
