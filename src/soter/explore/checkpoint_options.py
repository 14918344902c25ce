"""What a person may ask of checkpoints, checked before any test is searched.

Purpose: `--checkpoint` and `--resume` become one `Checkpoint` a test, or a diagnostic: what is
there already is not written over, and a search does not go on from a file that is no checkpoint, or
one of another search.
Non-goals: the file itself, and who writes it (`checkpoints.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, SoterError
from soter.explore.allowed_steps import plan_of
from soter.explore.checkpoints import (
    Checkpoint,
    machine,
    no_checkpoint,
    path_of,
    read,
    require_same,
)
from soter.explore.search_options import CHECKPOINT_SECONDS, SAMPLING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.codes import Code
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import System


@dataclass(frozen=True)
class CheckpointOptions:
    """A folder, how many seconds lie between two checkpoints, and whether it goes on from there."""

    folder: Path
    every_s: float
    resume: bool


def asked(options: SearchOptions) -> CheckpointOptions | None:
    """What is wanted, None: nothing; `SoterError` U001 where that cannot be."""
    checkpoint, resume, every = options.checkpoint, options.resume, options.checkpoint_every
    if (checkpoint, resume, every) == (None, None, None):
        return None
    problems = [Diagnostic("U001", m, helps=(help_,)) for m, help_ in _problems(options)]
    if problems:
        raise SoterError(tuple(problems))
    folder = checkpoint if resume is None else resume
    assert folder is not None
    if Path(folder).exists() and not Path(folder).is_dir():
        message = f"checkpoints stand in a folder, and `{folder}` is a file"
        help_ = "name a folder: every test has a file of its own in it"
        code: Code = "D006" if resume is None else "D012"
        raise SoterError((Diagnostic(code, message, helps=(help_,)),))
    every = CHECKPOINT_SECONDS if every is None else every
    return CheckpointOptions(Path(folder), every, resume is not None)


def _problems(options: SearchOptions) -> Iterator[tuple[str, str]]:
    """What cannot be, each with a help."""
    checkpoint, resume = options.checkpoint, options.resume
    if checkpoint is None and resume is None:
        yield "`checkpoint_every` alone writes nothing", "say where: `checkpoint`"
    if "" in (checkpoint, resume):
        yield "a checkpoint needs a folder, and `` is none", "`.` is this folder"
    if checkpoint is not None and resume is not None:
        message = "`checkpoint` begins anew and `resume` goes on: they cannot both be"
        yield message, "`resume` alone writes there, too"
    if options.strategy != "bfs":
        repeats = options.strategy in SAMPLING
        message = f"a search with the strategy `{options.strategy}` has no checkpoints"
        yield message, "its seed repeats it: --seed" if repeats else "bfs has: --strategy bfs"


def checkpoints(
    wanted: CheckpointOptions | None,
    systems: Sequence[System],
    options: SearchOptions,
    params: Mapping[str, object],
) -> list[Checkpoint | None]:
    """One for each of the flattened tests, in order; `SoterError` D006, D012, D013, D014."""
    if wanted is None:
        return [None for _ in systems]
    paths = [path_of(wanted.folder, plan_of(s).name) for s in systems]
    if wanted.resume and not any(p.exists() for p in paths):
        raise _nothing_there(wanted.folder, paths[0])
    diagnostics, made = Diagnostics(), []
    for system, path in zip(systems, paths, strict=True):
        try:
            made.append(_one(wanted, path, about(system, options, params)))
        except SoterError as error:
            for d in error.diagnostics:
                diagnostics.add(d)
    diagnostics.raise_errors()
    return list(made)


def _nothing_there(folder: Path, path: Path) -> SoterError:
    others = sorted(p.stem for p in folder.glob(f"*{path.suffix}"))
    if not folder.is_dir():
        return no_checkpoint(path, "there is no such folder")
    there = f"those there are of {', '.join(others)}" if others else "there is none in that folder"
    return no_checkpoint(path, f"no such file; {there}")


def about(
    system: System, options: SearchOptions, params: Mapping[str, object]
) -> dict[str, object]:
    """What has to be the same when it goes on: the keys of `files.ABOUT`."""
    plan = plan_of(system)
    return {
        "program_sha256": system.program.sha256,
        "system": system.name,
        "test": plan.name,
        "params": dict(params),
        "skew_ns": plan.skew_ns,
        "horizon_ns": plan.horizon_ns,
        "strategy": options.strategy,
        "storage": options.storage,
        "reduction": options.reduction,
        "seed": options.seed,
        "machine": machine(),
    }


def _one(wanted: CheckpointOptions, path: Path, facts: Mapping[str, object]) -> Checkpoint:
    if not path.exists():
        made = Checkpoint(path, wanted.every_s, facts)
        made.try_out()
        return made
    if not wanted.resume:
        message = f"there is a checkpoint already: `{path}`"
        hints = (f"go on from it: --resume {wanted.folder}", "or delete it, or take another folder")
        raise SoterError((Diagnostic("D014", message, helps=hints),))
    saved = read(path)
    require_same(saved, facts)
    made = Checkpoint(path, wanted.every_s, facts, saved)
    made.try_out()
    return made
