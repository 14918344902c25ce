"""Keeps the verdicts of proofs on this machine for runs and for the editor.

Purpose: `store_verdicts` keeps verdicts in the cache folder; `stored_verdicts` finds them for a
flat system. The key is everything that a proof depends on: every byte of the program and its data,
the system, all parameters, the module, and every byte of Soter itself. For the editor there is one
small file for each program, with verdicts on its last few texts, each with the hash of its text.
Non-goals: proofs of others (`soter recheck`); the verdicts of a program that was changed, or under
other parameters than the defaults in the editor.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import SoterError
from soter.language.model.proof_verdicts import Proof
from soter.native.cache import (
    cache_dir,
    digest,
    find_cached,
    is_trusted_file,
    new_entry,
    soter_sha256,
)
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import System
    from soter.verify.claims.results import ModuleResult


FILE = "proof.json"
WORST = ("proved", "assumed", "undecided", "refuted")


def store_verdicts(systems: Sequence[System], of: Sequence[ModuleResult]) -> None:
    """Stores the verdicts of results; each result is of a module of the system at the same index.

    A module that is proved in views has one result for each view, and the worst verdict counts. A
    cache that cannot be written is no error.
    """
    together: dict[tuple[str, str], list[ModuleResult]] = {}
    flying: dict[str, System] = {}
    for system, result in zip(systems, of, strict=True):
        module = result.name.removesuffix(f" as {result.problem.view}")
        flying.setdefault(system.name, system)
        together.setdefault((system.name, module), []).append(result)
    for (system_name, module), results in together.items():
        system = flying[system_name]
        names = dict.fromkeys(n for r in results for n in r.findings)
        verdicts = {
            n: max((r.findings[n].verdict for r in results if n in r.findings), key=WORST.index)
            for n in names
        }
        assumptions = assumption_texts(a for r in results for a in r.assumptions)
        text = json.dumps({"verdicts": verdicts, "assumptions": assumptions}, sort_keys=True)
        name, content = _entry_name(system, module), _content_hash(system, module)
        try:
            with new_entry(f"{name}-{digest((text,))[:8]}", content, (FILE,)) as entry:
                (entry / FILE).write_text(text, encoding="utf-8")
            _mark_of_entries(name).parent.mkdir(exist_ok=True, mode=0o700)
            _mark_of_entries(name).touch()
        except (OSError, SoterError):
            return  # later no verdict is found, which claims nothing


def stored_verdicts(system: System) -> dict[str, Proof]:
    """The stored proofs of modules for exactly this system, by name; other modules are left out.

    It is empty if runs of the system may do what no proof covers (faults, other orders, tests).
    """
    if system.faults or system.shuffled or system.test is not None or system.proved is not None:
        return {}
    proofs = {}
    for module in system.modules:
        proof = None if module.forced is not None else _cached_proof(system, module.name)
        if proof is not None:
            proofs[module.name] = proof
    return proofs


def _cached_proof(system: System, module: str) -> Proof | None:
    """The cached proof of a module; None if no proof is cached, or if several differ."""
    name = _entry_name(system, module)
    try:
        if not _mark_of_entries(name).exists():
            return None
        entries = sorted(cache_dir().glob(f"{name}-*"))
        if not entries:
            return None
        content = _content_hash(system, module)
        texts = set()
        for entry in entries:
            at = find_cached(entry.name.rsplit("-", 1)[0], content, (FILE,))
            if at is not None:
                texts.add((at / FILE).read_text(encoding="utf-8"))
    except (OSError, SoterError):
        return None
    if len(texts) != 1:
        return None
    document = json.loads(texts.pop())
    return Proof(dict(document["verdicts"]), tuple(document["assumptions"]))


def _mark_of_entries(name: str) -> Path:
    """A file that exists if the cache may have entries of this name, so that it is searched."""
    return cache_dir() / "verdicts" / name


def _key_parts(system: System, module: str) -> tuple[str, ...]:
    """The parts of a cache key: everything on which a proof depends, except Soter itself."""
    values = repr(sorted(system.params.items()))
    return ("proof 1", system.program.sha256, system.name, values, module)


def _entry_name(system: System, module: str) -> str:
    return f"proof-{digest(_key_parts(system, module))[:24]}"


def _content_hash(system: System, module: str) -> str:
    return digest((*_key_parts(system, module), soter_sha256()))


KEPT_TEXTS = 8
"""The number of texts of a program for which verdicts are kept."""
BYTES_MAX = 1024 * 1024


def store_verdicts_of_file(
    path: Path, program_sha256: str, modules: Mapping[str, Mapping[str, Any]]
) -> None:
    """Stores the verdicts on the modules of the program in `path`; ignores a failure to write.

    `modules` has plain data by module: `verdict`, `headline`, `system`, `seconds`, `horizon_ns`,
    `horizon_needed_ns` (each None if not known) and `properties` (verdicts by name).
    """
    file = _verdicts_file(path)
    records = stored_verdicts_of_file(path)
    same = next((r for r in records if r["program_sha256"] == program_sha256), None)
    now = {name: {**verdict, "when_s": time.time()} for name, verdict in modules.items()}
    before = {} if same is None else same["modules"]
    record = {"program_sha256": program_sha256, "modules": {**before, **now}}
    other_records = [r for r in records if r is not same]
    text = json.dumps({"soter": soter_sha256(), "records": [record, *other_records][:KEPT_TEXTS]})
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(dir=file.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        Path(temporary).replace(file)


def stored_verdicts_of_file(path: Path) -> list[dict[str, Any]]:
    """The verdicts that this version of Soter stored of the program in `path`, latest text first.

    Each has `program_sha256` and `modules` as `store_verdicts_of_file` was given them, with
    `when_s`, seconds since 1970. Empty where nothing can be read.
    """
    try:
        file = _verdicts_file(path)
        status = file.stat()
        if status.st_size > BYTES_MAX or not is_trusted_file(status):
            return []  # somebody else could have written it
        document = json.loads(file.read_text(encoding="utf-8"))
        records = document["records"] if document["soter"] == soter_sha256() else []
        return [r for r in records if isinstance(r["program_sha256"], str) and r["modules"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _verdicts_file(path: Path) -> Path:
    """The file with a program's verdicts; clearing the cache removes only folders and keeps it."""
    return cache_dir() / "verdicts" / f"{digest([str(path.resolve())])[:32]}.json"
