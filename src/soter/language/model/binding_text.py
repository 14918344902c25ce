"""The text that says what an extern is bound to.

Purpose: `"python:file.py:name"`, `"c:file.c:name"`, `"onnx:file.onnx"`, `"sb3:file.zip"`,
`"onnx:file.onnx:h0=hn"` and `"sb3:file.zip:vecnormalize.pkl"`, in their parts.
Non-goals: whether there are such files (`simulate/externs/`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

NAMED = ("python", "c")
"""Kinds with a name inside of the file."""
NO_STATISTICS = "none"
"""In the place of a file of statistics: there is none, whatever lies beside the policy."""
POLICIES = ("onnx", "sb3")
"""Kinds of files that hold a learned policy."""
CLIP = "clip"
OF_ONNX = re.compile(rf"({CLIP}|[^=,]+=[^=,]+)(,[^=,]+=[^=,]+)*(,{CLIP})?")
"""Of an ONNX file: answers are put into their sets; which output is the next value of an input."""
FORMS = {
    "python": "python:file.py:name",
    "c": "c:file.c:name",
    "onnx": "onnx:file.onnx",
    "sb3": "sb3:file.zip",
}


class BindingText(NamedTuple):
    """The parts; `name`: of what is in the file.

    Of a policy the file of its statistics, or which outputs are remembered, or "".
    """

    kind: str
    file: str
    name: str

    @property
    def is_policy(self) -> bool:
        """Whether a file of a learned policy answers."""
        return self.kind in POLICIES

    @property
    def in_python(self) -> bool:
        """Whether Python answers: what is in no C that is linked."""
        return self.kind != "c"

    @property
    def files(self) -> tuple[str, ...]:
        """All files that are named."""
        return (self.file, self.name) if self.statistics else (self.file,)

    @property
    def statistics(self) -> str:
        """The file of a policy's statistics; "" where none is named."""
        named = self.kind == "sb3" and self.name != NO_STATISTICS
        return self.name if named else ""

    @property
    def remembered(self) -> str:
        """Which outputs of an ONNX file are next values of inputs; "" where nothing is said."""
        return ",".join(part for part in self.name.split(",") if part != CLIP)

    @property
    def clips(self) -> bool:
        """Whether the answer of an ONNX file is put into the sets of its topics."""
        return self.kind == "onnx" and CLIP in self.name.split(",")

    def beside(self, folder: Path) -> BindingText:
        """The same with its files looked for in a folder."""
        name = str(folder / self.name) if self.statistics else self.name
        return BindingText(self.kind, str(folder / self.file), name)

    def __str__(self) -> str:
        return ":".join(self if self.name else self[:2])


def binding_of(text: str | None) -> BindingText | None:
    """The parts of a text; None where it can be no binding."""
    parts = (text or "").split(":")
    if not all(parts) or parts[0] not in FORMS:
        return None
    name = parts[2] if len(parts) > 2 else ""
    if parts[0] == "onnx" and name and not OF_ONNX.fullmatch(name):
        return None
    least = 3 if parts[0] in NAMED else 2
    return BindingText(parts[0], parts[1], name) if (least <= len(parts) <= 3) else None


def is_in_python(text: str | None) -> bool:
    """Whether a text binds to what Python answers."""
    binding = binding_of(text)
    return binding is not None and binding.in_python
