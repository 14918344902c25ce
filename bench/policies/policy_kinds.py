"""Policies of every kind that people have, against what their own library answers.

    python bench/policies/policy_kinds.py --peer PYTHON [--observations 10000] [--kinds FOLDER]

PYTHON is an interpreter that has stable-baselines3, sb3-contrib, torch, onnx, onnxscript, skl2onnx
and scikit-learn, and needs no Soter: it makes a policy of each kind (algorithm x architecture x
space x option) and says what `predict(deterministic=True)` answers to observations drawn over its
space; what keeps memory, and stacked frames, in episodes of 1 to 200 steps. Soter then reads the
same files without those libraries and answers as a node does, episode by episode, what VecNormalize
saved found beside the file.

A kind is *as its library* where every answer is within 1e-6 of max(1, the largest value of a
layer), every index the same; or it is refused, with what to do instead. Target: every kind is one
of the two.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import ArrayType, FloatType, IntType
from soter.policy.policy_extern import load_policy

WITHIN = 1e-6
LARGE = 2**31 - 1


def main() -> int:
    """Make the files, or take those that are there; ask; print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer", default="", help="a Python with the libraries")
    parser.add_argument("--observations", type=int, default=10_000)
    parser.add_argument("--only", default="", help="kinds with this in their name")
    parser.add_argument("--kinds", type=Path, help="a folder for the files, or with them")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = args.kinds or Path(made)
        if args.peer:
            script = Path(__file__).with_name("make_kinds.py")
            given = [
                str(folder),
                "--observations",
                str(args.observations),
                "--only",
                args.only,
            ]
            subprocess.run([args.peer, str(script), *given], check=True)
        told = json.loads((folder / "kinds.json").read_text(encoding="utf-8"))
        rows = [compared(folder, kind) for kind in told["kinds"] if args.only in kind["name"]]
    versions = ", ".join(f"{name} {version}" for name, version in told["versions"].items())
    print(f"{versions}; {args.observations:,} observations a kind\n")
    print(f"{'kind':38} {'largest difference':>18}  {'indices':>9}  verdict")
    for name, row in zip([k["name"] for k in told["kinds"]], rows, strict=False):
        print(f"{name:38} {row[0]:>18}  {row[1]:>9}  {row[2]}")
        for line in row[3]:
            print(f"{'':38}   {line}")
    words = [row[2] for row in rows]
    good, refused = words.count("as its library"), words.count("refused")
    print(
        f"\n{len(rows)} kinds: {good} as their library, {refused} refused with a way out, ", end=""
    )
    print(f"{len(rows) - good - refused} neither (target 0)")
    return int(good + refused < len(rows))


def compared(folder: Path, kind: dict[str, Any]) -> tuple[str, str, str, list[str]]:
    """Largest difference, indices that differ, the verdict, and what is said of it."""
    binding = binding_of(kind["from"])
    if binding is None:
        return "", "", "no binding", [kind["from"]]
    own = (folder / binding.file).parent
    seen, answers = np.load(own / "seen.npz"), np.load(own / "answers.npz")
    reads = [(n, type_of(seen[n])) for n in sorted(seen, reverse=True)]
    acted = answers["acted"]
    element = IntType(0, LARGE) if kind["whole"] else FloatType()
    try:
        policy = load_policy(
            binding.in_folder(folder), reads, [("act", ArrayType(element, acted.shape[1]))], None
        )
    except SoterError as error:
        (problem,) = error.diagnostics
        verdict = "refused" if problem.helps else "refused without a way out"
        said = [problem.message.partition("`: ")[2], *(f"help: {h}" for h in problem.helps)]
        return "", "", verdict, said
    given = [rows(seen[n]) for n, _ in reads]
    mine = np.empty_like(acted)
    for k, start in enumerate(answers["starts"]):
        if start:
            policy.reset(0)
        inputs = {n: column[k] for (n, _), column in zip(reads, given, strict=True)}
        mine[k] = policy.step(SimpleNamespace(**inputs))[0]
    if kind["whole"]:
        differ = int((mine != acted).any(axis=1).sum())
        return "", f"{differ}", "as its library" if not differ else f"{differ} differ", []
    scale = np.maximum(1.0, answers["scale"])[:, None]
    largest = float((np.abs(mine - acted) / scale).max())
    return f"{largest:.1e}", "", "as its library" if largest <= WITHIN else "too far", []


def type_of(column: Any) -> Any:  # noqa: ANN401 - an array
    """The type of a topic that holds a row of the column, of one axis or several."""
    whole = column.dtype.kind in "iu"
    made: Any = IntType(0, LARGE) if whole else FloatType()
    for size in column.shape[:0:-1]:
        made = ArrayType(made, size)
    return made


def rows(column: Any) -> list[Any]:  # noqa: ANN401 - an array
    """Rows as an extern is given them: whole numbers as lists."""
    return column.tolist() if column.dtype.kind in "iu" else list(column.astype(np.float64))


if __name__ == "__main__":
    sys.exit(main())
