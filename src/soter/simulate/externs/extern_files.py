"""Which bytes answer an extern: SHA-256 of the files that its binding names, and what those need.

Purpose: runs and their logs say it, as other weights are another controller and the hash of the
program knows nothing of them.
Non-goals: what Python imports, and objects that are bound from Python: nobody can name their files.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from soter.language.load.bounded_read import read_bytes
from soter.language.model.binding_text import binding_of
from soter.native.includes import included
from soter.policy.policy_errors import content_of

if TYPE_CHECKING:
    from soter.language.model.binding_text import BindingText


def files_of(bound: object) -> dict[str, str]:
    """SHA-256 by the name of each file; empty for what no text binds. SoterError X003, X014."""
    binding = binding_of(bound) if isinstance(bound, str) else None
    if binding is None:
        return {}
    if binding.kind == "c":
        texts = included(binding.file)
        return {str(p): _sha256(t.encode("utf-8", "surrogateescape")) for p, t in texts.items()}
    if not binding.is_policy:
        return {binding.file: _sha256(read_bytes(Path(binding.file)))}
    told = {name: _sha256(content_of(Path(name))) for name in binding.files}
    return told | _weights(binding)


def _weights(binding: BindingText) -> dict[str, str]:
    """Of the files beside an ONNX file that it names."""
    if binding.kind != "onnx":
        return {}
    from soter.policy.onnx_content import onnx_content  # noqa: PLC0415 - may need an extra

    path = Path(binding.file)
    return {str(path.parent / name): sha for name, sha in onnx_content(path).beside.items()}


def _sha256(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()
