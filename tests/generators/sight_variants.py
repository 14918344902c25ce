"""`certain` of examples/exploration/sight.soter and wrong variants of it, compiled.

Purpose: the distance that one scan makes certain, called as a function. All variants lie in one
library: each is the text of sight.soter with edits, beside the files that it imports.
Non-goals: scans and judging the answers (`sight_scenes.py`, `sight_referee.py`).
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from generators.exploration_mappers import EXAMPLES, edited
from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import library

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from generators.exploration_mappers import Edits

MAIN = """soter 1;
{imports}
topic answers: float[{count}];
topic asked: {{ sweep: sight0.Sweep, v: float, old: float }};
plant Asking period 50ms {{
  drives asked = {{ sweep: {{ ranges: [n], newest: 0 }}, v: n, old: n }};
  state n: float;
  next n = n;
}}
node Ask period 50ms {{
  subscribes asked;
  publishes answers;
  step {{ publish answers = [{calls}]; }}
}}
system Main {{ a: Asking; node Ask; until 1s; }}
"""
CALL = "sight{k}.certain(asked.sweep, asked.v, asked.old)"
OPENING = (
    "bool soter_certain_{k}(const double *ranges, int count, int newest, double v, double old,"
    " double *gap);"
)
BODY = """
bool soter_certain_{k}(const double *ranges, int count, int newest, double v, double old,
    double *gap) {{
  static {p}_sight0_Sweep sweep;
  memset(&sweep, 0, sizeof sweep);
  sweep.ranges.len = count;
  memcpy(sweep.ranges.items, ranges, (size_t)count * sizeof *ranges);
  sweep.newest = newest;
  soter_fault fault = SOTER_OK;
  *gap = {p}_sight{k}_certain_fn(&sweep, v, old, &fault);
  return fault == SOTER_OK;
}}
"""


class Sights:
    """Variants of `certain` by name; the text as it is has no edits. `work`: a folder for them."""

    def __init__(self, variants: Mapping[str, Edits], work: Path) -> None:
        shutil.copytree(EXAMPLES / "drone", work / "drone")
        folder = work / "exploration"
        shutil.copytree(EXAMPLES / "exploration", folder)
        whole = (folder / "sight.soter").read_text(encoding="utf-8")
        text = whole[: whole.index("node Sight")]
        for k, edits in enumerate(variants.values()):
            (folder / f"sight{k}.soter").write_text(edited(text, edits), encoding="utf-8")
        numbers = range(len(variants))
        main = folder / "sights.soter"
        imports = "\n".join(f'import "sight{k}.soter" as sight{k};' for k in numbers)
        calls = ", ".join(CALL.format(k=k) for k in numbers)
        main.write_text(
            MAIN.format(imports=imports, count=len(variants), calls=calls), encoding="utf-8"
        )
        checked = check_file(str(main))
        assert checked.ok, checked.diagnostics.items
        assert checked.program is not None
        self.constants: dict[str, Any] = {n: c.value for n, c in checked.program.consts.items()}
        unit = generate(system_of(checked, "Main", {}))
        openings = "\n".join(OPENING.format(k=k) for k in numbers)
        glue = "".join(BODY.format(k=k, p=unit.prefix) for k in numbers)
        source = f"{unit.source}\n#include <string.h>\n{openings}\n{glue}"
        self._ffi: Any = FFI()
        self._ffi.cdef(openings)
        opened: Any = self._ffi.dlopen(str(library(replace(unit, source=source), "-O1")))
        self._calls = {
            name: getattr(opened, f"soter_certain_{k}")
            for name, k in zip(variants, numbers, strict=True)
        }

    def certain(
        self, name: str, ranges: NDArray[np.float64], newest: int, v: float, old: float
    ) -> float:
        """The distance that nobody is nearer than, m. v: m/s; old: s."""
        r = np.ascontiguousarray(ranges)
        gap = self._ffi.new("double *")
        at = self._ffi.cast("double *", r.ctypes.data)
        assert self._calls[name](at, len(r), newest, v, old, gap), f"{name} faults"
        return float(gap[0])
