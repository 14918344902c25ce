"""`soter policy FILE`: tells what a learned policy's file says, and writes the policy as Soter.

Purpose: prints observation, answer, layers, what is assumed, and how far the network in float64
can be from float32; with `-o` it writes the network as a function of Soter, with `--node` as C.
Non-goals: reading files and bounds (`soter.policy`), running policies (`soter run`).
"""

from __future__ import annotations

import argparse
import hashlib
import math
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api import format_text, load
from soter.cli.terminal.command_line import UsageError
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.shared_options import file_option
from soter.diagnostics.command_records import option, read_by
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.report.atomic_write import atomic_write

if TYPE_CHECKING:
    from soter.cli.terminal.console import Console
    from soter.policy.network import Doubles, Policy

EXAMPLES = """\
  soter policy rush.onnx
  soter policy ppo.zip --statistics vecnormalize.pkl
  soter policy rush.onnx --within 10,6,50 -o rush.soter     a function: import it, call `rush.act`
  soter policy rush.zip --node rush.soter:Learned -o learned.c
  soter campaign rush.soter --bind Learned=c:learned.c:Learned_step

A node is answered by the file itself with `extern node X ... from "onnx:rush.onnx"`, or from
"sb3:ppo.zip" or "sb3:ppo.zip:vecnormalize.pkl". Statistics that lie beside the zip are found;
`none` in their place says that there are none. What `-o` writes needs no file and no Python: a
small network of linear layers, ReLU and tanh, in C, with a cost that `soter check` tells. With
`--node` it is the C of that extern node instead, of any network that is read: for campaigns.

exit codes: 0 told or written, 1 diagnostics, 2 usage
"""
WIDTH = len("observation")


def _size_list(text: str) -> list[float]:
    """The list of observation sizes, finite and not negative; ArgumentTypeError for other text."""
    try:
        sizes = [float(part) for part in text.split(",")]
    except ValueError:
        sizes = []
    if not sizes or not all(math.isfinite(x) and x >= 0.0 for x in sizes):
        raise argparse.ArgumentTypeError(f"takes sizes with commas between, not `{text}`")
    return sizes


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the file of a learned policy says."""

    file: str = file_option(words="an ONNX file, or a zip of Stable-Baselines3")
    statistics: str | None = option(
        "--statistics FILE", None, "what VecNormalize saved, or `none`; else what lies beside"
    )
    within: list[float] | None = option(
        "--within LIST",
        None,
        "how large observations are at most, one number or one each: for the bound",
        read_by(_size_list),
    )
    output: str | None = option("-o --output FILE", None, "write the network as Soter, or as C")
    node: str | None = option(
        "--node PROGRAM:NAME", None, "with -o FILE.c: the C of this extern node of the program"
    )
    NEEDS = (("output", "node"),)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Reads, prints and writes the policy; UsageError or SoterError U001 if options clash."""
    from soter.policy.soter_source import error_bound  # noqa: PLC0415 - needs NumPy

    if args.output is not None and args.output.endswith(".c") != (args.node is not None):
        help_ = "C of a node: --node PROGRAM:NAME -o FILE.c; a function of Soter: -o FILE.soter"
        raise mistake("U001", f"`{args.output}` has the ending of another language", help_)
    policy = _read_policy(Path(args.file), args.statistics)
    box = _input_box(policy, args.within)
    bound = None if box is None else float(error_bound(policy.network, *box).max())
    facts = {
        **policy.facts,
        "layers": _layers_text(policy),
        "float64": _bound_text(policy, box, bound),
    }
    for name, text in [*facts.items(), *(("assumed", text) for text in policy.assumed)]:
        console.say(f"{console.paint('muted', name.ljust(WIDTH))}  {text}")
    fields: dict[str, object] = {
        "facts": facts,
        "assumed": list(policy.assumed),
        "inputs": policy.network.inputs,
        "outputs": policy.network.answer_count,
        "bound": bound,
        "output": args.output,
    }
    if args.output is not None:
        if args.node is not None:
            fields["bind"] = _write_c(Path(args.output), policy, args.node)
        else:
            _write_soter(Path(args.output), policy, args.file, facts)
        console.say(f"\nwritten  {args.output}")
        if args.node is not None:
            console.say(f"bind it  --bind {fields['bind']}")
    return CommandOutcome(fields=fields)


def _read_policy(path: Path, statistics: str | None) -> Policy:
    if path.suffix != ".onnx":
        from soter.policy.sb3_file import read_sb3  # noqa: PLC0415 - needs NumPy

        return read_sb3(path, None if statistics is None else Path(statistics))
    if statistics is not None:
        raise UsageError("--statistics goes with a file of Stable-Baselines3")
    from soter.policy.onnx_file import read_onnx  # noqa: PLC0415 - an extra

    return read_onnx(path)


def _input_box(policy: Policy, within: list[float] | None) -> tuple[Doubles, Doubles] | None:
    """The bounds of observations from `--within`, else from the file; None if neither has them."""
    import numpy as np  # noqa: PLC0415 - as above

    if within is None:
        return policy.box
    inputs = policy.network.inputs
    if len(within) not in (1, inputs):
        raise UsageError(f"--within has {len(within)} numbers, the policy takes {inputs}")
    sizes = np.broadcast_to(np.array(within), (inputs,))
    return -sizes, sizes


def _layers_text(policy: Policy) -> str:
    from soter.policy.network import Affine  # noqa: PLC0415 - as above

    names = []
    for layer in policy.network.layers:
        size = f" {layer.weight.shape[0]}" if isinstance(layer, Affine) else ""
        names.append(f"{type(layer).__name__.lower()}{size}")
    return f"{policy.network.inputs} numbers, {', '.join(names)}"


def _bound_text(policy: Policy, box: tuple[Doubles, Doubles] | None, bound: float | None) -> str:
    from soter.policy.network import Tanh  # noqa: PLC0415 - as above
    from soter.policy.soter_source import unwritable_part  # noqa: PLC0415 - as above

    if unwritten := unwritable_part(policy.network):
        return f"no bound: it has {unwritten}, not written as a function"
    if box is None or bound is None:
        return "no bound: the file does not say how large observations are (--within)"
    if not math.isfinite(bound):
        return "no bound: numbers may be too large for float32 (--within)"
    ends = [f"[{a:g}, {b:g}]" for a, b in zip(*box, strict=True)]
    inside = ends[0] if len(set(ends)) == 1 else ", ".join(ends[:8] + ["..."] * (len(ends) > 8))
    above = Decimal(bound).normalize(Context(prec=3, rounding=ROUND_CEILING))
    has_tanh = any(isinstance(layer, Tanh) for layer in policy.network.layers)
    caveat = " whose tanh is within 2^-21" if has_tanh else ""
    return f"within {float(above):.3g} of float32{caveat}, for observations in {inside}"


def _write_soter(path: Path, policy: Policy, file: str, facts: dict[str, str]) -> None:
    from soter.policy.policy_errors import read_policy_bytes  # noqa: PLC0415 - as above
    from soter.policy.soter_source import soter_source  # noqa: PLC0415 - as above

    notes = [
        f"{Path(file).name} as a function, written by `soter policy`: do not edit.",
        f"sha256 {hashlib.sha256(read_policy_bytes(Path(policy.path))).hexdigest()}",
        "",
        *(f"{name}: {text}" for name, text in facts.items()),
        *(f"assumed: {text}" for text in policy.assumed),
        "",
    ]
    text = format_text(str(path), soter_source(policy, notes))
    with atomic_write(path) as stream:
        stream.write(text.encode())


def _write_c(path: Path, policy: Policy, node: str) -> str:
    """Writes the policy as C of an extern node; gives the value for `--bind`; UsageError."""
    from soter.codegen.unit import generate  # noqa: PLC0415 - as above
    from soter.policy.c_source import c_source  # noqa: PLC0415 - as above
    from soter.policy.policy_extern import reads_in_order  # noqa: PLC0415 - as above

    file, _, name = node.rpartition(":")
    program = load(file or node)
    if not program.ok:
        raise SoterError(program.diagnostics)
    for system in map(program.declared, program.systems):
        for x in system.components:
            if x.node is None or not x.extern or name not in (x.name, x.name.rpartition(".")[2]):
                continue
            topics = [s.topic for s in x.node.subscribes]
            reads = [
                (t.name.rpartition(".")[2], system.topics[x.scope.topics[t]].type) for t in topics
            ]
            if policy.keys:
                reads = list(reads_in_order(Path(policy.path), policy.keys, policy.shapes, reads))
            unit = generate(system)
            node_name = unit.names[x.index]
            function = f"{name.rpartition('.')[2]}_step"
            text = c_source(policy, function, node_name, f"{unit.prefix}.h", reads, x.node.answers)
            with atomic_write(path) as stream:
                stream.write(text.encode())
            return f"{name}=c:{path}:{function}"
    raise UsageError(f"--node takes PROGRAM:NAME of an extern node, not `{node}`")
