"""Builds packages.

Purpose: `build` makes the package of a target, with what its system inherits; `built_image` and
`stack_bound` measure it.
Non-goals: which proof is inherited (`inheritance.py`), the run that an image repeats
(`host_replay.py`), the files of a package (`targets/`).
"""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.addons import load_module
from soter.api.deploy.host_replay import replay_on_host
from soter.api.deploy.inheritance import inheritance_report
from soter.language.load.named_files import binding_of
from soter.native.extern_bindings import Bindings, require_readable_c
from soter.simulate.result_assumptions import code_assumptions
from soter.targets.cortex_m_board import read_board
from soter.targets.cortex_m_image import Image, build_image, cross_compiler, require_enough_stack
from soter.targets.package import TARGETS, Package, build_package, require_options
from soter.verify.proof_cache import stored_verdicts

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from soter.language.model.system import System
    from soter.native.stack_bound import StackBound
    from soter.verify.deploy.missing_predicates import Known

MAPPINGS = "soter.mapping.read_mapping"
NO_PART = frozenset({"soter_app.c", "soter_virtual.c", "soter_sha256.c"})
"""Files of a package that only the command for virtual time needs."""


def build(
    target: str,
    output: Path,
    fresh: System,
    completed: Callable[[Known | None], tuple[System, list[str]]],
    bound: Callable[[System], Bindings],
    *,
    cert: str | Path | None,
    mapping: str | Path | Mapping[str, Any] | None = None,
    board: str | None = None,
) -> Package:
    """Writes the package of a target into the folder `output`.

    `completed` takes the predicates that a certificate confirms, or None, and returns the system
    with computed predicates, and notes. `mapping`: a file or its content, for targets with a
    middleware. `board`: the name or file of a board, for targets that are an image.

    Raises the errors of `inheritance_report` and `build_package`.
    """
    require_options(target, mapping=mapping is not None, board=board is not None)
    place = None if board is None else read_board(board)
    file = Path(mapping) if isinstance(mapping, (str, Path)) else None
    read = mapping if file is None else load_module(MAPPINGS).read_mapping(file)

    def mapping_for_system(system: System) -> object:
        return None if read is None else load_module(MAPPINGS).make_log_map(read, system, file=file)

    mapping_for_system(fresh)  # a wrong one is told before anything takes long,
    bare = bound(fresh)
    require_readable_c(bare)
    if read is not None and all(m.symbol.ttf for m in fresh.modules):  # and what no bridge can do
        here = bare.system, bare.core, output, mapping_for_system(bare.system)
        build_package(target, *here, write=False)
    inherits = inheritance_report(fresh, cert)
    flat, computed = completed(inherits.sets)
    flat.certificate = inherits.certificate
    bindings = bound(flat)
    onto = None if place is None else (place, replay_on_host(bindings))
    fits = mapping_for_system(bindings.system)
    package = build_package(
        target, bindings.system, bindings.core, output, fits, inherits.files, onto
    )
    assumed = [] if inherits.lines else code_assumptions(flat, stored_verdicts(flat))
    dropped = _left_out_bindings(bindings) if TARGETS[target].drops_bindings else ()
    package.notes += [*assumed, *computed, *dropped]
    package.inherited, package.inherits = inherits.document, inherits.lines
    return package


def _left_out_bindings(bindings: Bindings) -> list[str]:
    """Notes on bindings to Python or to policies, which a C package does not contain."""
    notes = []
    for x in bindings.externs:
        binding = binding_of(x.bound) if isinstance(x.bound, str) else None
        if binding is not None and binding.is_policy:
            file = Path(binding.file)
            way = f"`soter policy {file} -o {file.stem}.soter` writes it as a function in Soter"
            way = way if file.is_file() else f"there is no file `{file}`"
            notes.append(f"{x.name}: its policy is left out, as the package is C: {way}")
        elif x.bound is not None and not str(x.bound).startswith("c:"):
            notes.append(f"{x.name}: its binding to Python is left out, as the package is C")
    return notes


def built_image(package: Package, board: str | None, stack: StackBound) -> Image | None:
    """Builds the image of a package for a board; None without a board. See `build_image`.

    `stack`: the stack bound of the package. Raises SoterError X015 if the board has less stack.
    """
    if board is None:
        return None
    place = read_board(board)
    require_enough_stack(stack, place)
    return build_image(package, place)


def stack_bound(package: Package, board: str | None = None) -> StackBound:
    """The most stack that the trusted part of a package needs, compiled on this machine.

    `board`: for an image, whose own compiler computes it.

    Externs, plants and the virtual-time command are not counted.
    """
    from soter.native.stack_bound import stack_bound  # noqa: PLC0415 - runs a compiler

    files = {
        PurePath(f.path).name: f.text
        for f in package.files
        if str(PurePath(f.path).parent) == (package.trusted or ".")
        and not f.yours
        and f.path.endswith((".c", ".h"))
        and PurePath(f.path).name not in NO_PART
        and "int main(" not in f.text
    }
    cross = None if board is None else cross_compiler(read_board(board))
    return stack_bound(files, package.entries, package.world, cross)
