"""Write what was proved as a folder for `soter recheck` (docs/verification.md, section 4).

Purpose: program files, tables and manifest of some verification results, sealed.
Non-goals: checking anything; figures and reports, which go elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from soter.certificate.format.folder import FORMAT, MANIFEST, SEAL, files_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError, reason
from soter.verify.module_methods import module_method

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.verify.claims.results import ModuleResult


def write(
    folder: Path, program: TypedProgram, results: Sequence[ModuleResult], systems: Sequence[str]
) -> None:
    """Write the certificate of `results`, each of a module in the system of that name.

    An old certificate in the folder is replaced. `SoterError` D008 where something else lies
    there, D006 where the system refuses.
    """
    files = dict(_sources(program))
    main = _main(program, files)
    modules = []
    for k, (result, system) in enumerate(zip(results, systems, strict=True)):
        entry = module_method(result.problem).entry
        modules.append(entry(result, system, f"sets/{k}", files))
    manifest = {
        "schema": FORMAT,
        "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        "main": main,
        "params": _params(results),
        "program_sha256": program.sha256,
        "modules": modules,
    }
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    raw = (text + "\n").encode()
    files[MANIFEST] = raw
    files[SEAL] = (hashlib.sha256(raw).hexdigest() + "\n").encode()
    _replace(folder, files)


# ---------------------------------------------------------------- the program


def _sources(program: TypedProgram) -> Iterator[tuple[str, bytes]]:
    """Each file by its path below the deepest folder that holds all of them."""
    paths = list(dict.fromkeys(p.resolve() for p in files_of(program.path)))
    root = Path(os.path.commonpath([p.parent for p in paths]))
    for path in paths:
        yield f"program/{path.relative_to(root).as_posix()}", path.read_bytes()


def _main(program: TypedProgram, files: dict[str, bytes]) -> str:
    """The main file is the first."""
    name = next(iter(files)).removeprefix("program/")
    assert name.endswith(Path(program.path).name)
    return name


def _params(results: Sequence[ModuleResult]) -> dict[str, object]:
    """The values of all parameters, floats as C99 hexadecimal texts.

    Without those that are not the same in all systems: there each system says its own (`set`).
    """
    values: dict[str, Value] = {}
    differ: set[str] = set()
    for result in results:
        for name, value in result.problem.system.params.items():
            if repr(values.setdefault(name, value)) != repr(value):
                differ.add(name)
    for name in differ:
        del values[name]
    return {n: v.hex() if isinstance(v, float) else v for n, v in values.items()}


# ---------------------------------------------------------------- the folder


def _replace(folder: Path, files: dict[str, bytes]) -> None:
    """Only files of an old certificate are removed, and only where it is one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        old = [p for p in folder.rglob("*") if not p.is_dir() or p.is_symlink()]
        names = {p.relative_to(folder).as_posix() for p in old}
        strange = {n for n in names if n.split("/")[0] not in ("program", "sets", MANIFEST, SEAL)}
        if strange or (names and MANIFEST not in names):
            raise SoterError((_in_the_way(folder, min(strange or names)),))
        for path in old:
            path.unlink()
        for path in sorted(folder.rglob("*"), reverse=True):
            path.rmdir()
        for name, data in files.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
    except OSError as error:
        why = reason(error)
        problem = Diagnostic("D006", f"cannot write the certificate `{folder}`: {why}")
        raise SoterError((problem,)) from None


def _in_the_way(folder: Path, name: str) -> Diagnostic:
    return Diagnostic(
        "D008",
        f"`{folder}` holds `{name}`, which is no part of a certificate",
        helps=("name a new or empty folder",),
    )
