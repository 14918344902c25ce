"""What was proved lately of which program: verdicts, kept for the editor to show.

Purpose: one small file a program in the cache folder, with verdicts on the last few texts of it. A
verdict is of one text, one set of data files and one Soter; whoever shows it compares the hash.
Non-goals: proofs (`soter recheck` is for those), verdicts under other parameters than the defaults.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.native.cache import cache_dir, digest, is_ours
from soter.native.source_files import soter_sha256

if TYPE_CHECKING:
    from collections.abc import Mapping

KEPT_TEXTS = 8
"""Of so many texts of a program the verdicts are kept."""
BYTES_MAX = 1024 * 1024


def store_verdicts(
    path: Path, program_sha256: str, modules: Mapping[str, Mapping[str, Any]]
) -> None:
    """Keep what was said of modules of the program in `path`; what cannot be written is forgotten.

    `modules`: plain data by module: `verdict`, `headline`, `system`, `seconds`, `horizon_ns`,
    `horizon_needed_ns` (None where there is none) and `properties` (verdicts by name).
    """
    file = _file(path)
    known = stored_verdicts(path)
    same = next((r for r in known if r["program_sha256"] == program_sha256), None)
    now = {name: {**said, "when_s": time.time()} for name, said in modules.items()}
    before = {} if same is None else same["modules"]
    record = {"program_sha256": program_sha256, "modules": {**before, **now}}
    rest = [r for r in known if r is not same]
    text = json.dumps({"soter": soter_sha256(), "records": [record, *rest][:KEPT_TEXTS]})
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, made = tempfile.mkstemp(dir=file.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        Path(made).replace(file)


def stored_verdicts(path: Path) -> list[dict[str, Any]]:
    """What was kept of the program in `path` by this very Soter, the latest text first.

    Each has `program_sha256` and `modules` as `store_verdicts` was given them, with `when_s`,
    seconds since 1970. Empty where nothing can be read.
    """
    try:
        file = _file(path)
        status = file.stat()
        if status.st_size > BYTES_MAX or not is_ours(status):
            return []  # somebody else could have written it
        document = json.loads(file.read_text(encoding="utf-8"))
        records = document["records"] if document["soter"] == soter_sha256() else []
        return [r for r in records if isinstance(r["program_sha256"], str) and r["modules"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _file(path: Path) -> Path:
    """Beside the cache's entries, which are folders: nobody who makes room there removes it."""
    return cache_dir() / "verdicts" / f"{digest([str(path.resolve())])[:32]}.json"
