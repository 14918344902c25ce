"""Object files of the run-time, compiled once and kept in the cache.

Purpose: what every program of a kind is linked with need not be compiled for each of them.
Non-goals: generated code (`build.py`).
"""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from pathlib import Path

from soter.diagnostics.diagnostic import Diagnostic, SoterError

TIMEOUT_S = 300


def kept_objects(
    sources: tuple[Path, ...], command: tuple[str, ...], folder: Path, content: str
) -> tuple[str, ...]:
    """The objects of some C files, from `folder` or compiled there; SoterError X004.

    `command`: compiler and flags; `content`: a hash of everything that the objects depend on.
    Anything damaged or missing is built again.
    """
    kept = folder / f"objects-{content[:32]}"
    names = tuple(f"{s.stem}.o" for s in sources)
    try:
        seals = (kept / "seals").read_text(encoding="utf-8").split()
        if seals == [_hash(kept / n) for n in names]:
            return tuple(str(kept / n) for n in names)
    except (OSError, UnicodeDecodeError):
        pass
    with tempfile.TemporaryDirectory(dir=folder, prefix="build-") as name:
        made = Path(name)
        _compile((*command, "-c", *(str(s) for s in sources)), made)
        kept.mkdir(exist_ok=True)
        seals = [_hash(made / n) for n in names]
        for n in names:
            (made / n).replace(kept / n)
        (made / "seals").write_text("\n".join(seals), encoding="utf-8")
        (made / "seals").replace(kept / "seals")
    return tuple(str(kept / n) for n in names)


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _compile(command: tuple[str, ...], work: Path) -> None:
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S, cwd=work
    )
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        helps = ("this is a defect of soter: please report it with your compiler's version",)
        message = "the run-time does not compile"
        raise SoterError((Diagnostic("X004", message, notes=tuple(lines[:8]), helps=helps),))
