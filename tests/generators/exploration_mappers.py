"""`Mapper` of examples/exploration and wrong variants of it, compiled: one step on one scan.

Purpose: the node's own step, origin and doubt included, called as a function. All variants lie in
one library: each is the text of mapper.soter with edits, beside the files that it imports.
Non-goals: scans (`exploration_scenes.py`), judging the answers (`exploration_referee.py`).
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import library

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Edits = Sequence[tuple[str, str]]

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SENSOR = """soter 1;
import "worlds.soter" as worlds;
{imports}
plant Sensor period 5ms {{
  drives worlds.scan = {{
    ranges: worlds.never_sent(), newest: 0, at: {{ x: n, y: n, vx: n, vy: n }}
  }};
  state n: float;
  next n = n;
}}
system Main {{ s: Sensor; {nodes} until 1s; }}
"""
SURVEYOR = "const MOST: int"
"""Where what a variant needs of mapper.soter ends."""
STEP = """
bool soter_step_{k}(const double *ranges, int newest, const double *pose, uint8_t *map,
    bool *doubt) {{
  static {p}_state state;
  memset(&state, 0, sizeof state);
  {p}_worlds_Scan *scan = &state.topics.worlds_scan;
  memcpy(scan->ranges.at, ranges, sizeof scan->ranges.at);
  scan->newest = newest;
  scan->at.x = pose[0];
  scan->at.y = pose[1];
  scan->at.vx = pose[2];
  scan->at.vy = pose[3];
  memcpy(state.Mapper{k}.map.at, map, sizeof state.Mapper{k}.map.at);
  uint32_t published = 0U;
  const soter_fault fault = {p}_Mapper{k}_step(&state, 0U, &published, NULL);
  memcpy(map, state.Mapper{k}.map.at, sizeof state.Mapper{k}.map.at);
  *doubt = state.Mapper{k}.doubtful;
  return fault == SOTER_OK;
}}
"""
OPENING = (
    "bool soter_step_{k}(const double *ranges, int newest, const double *pose, "
    "uint8_t *map, bool *doubt);"
)


def edited(text: str, edits: Edits) -> str:
    """The text with each of the replacements made in its only place."""
    for old, new in edits:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in mapper.soter"
        text = text.replace(old, new)
    return text


class Mappers:
    """Variants of `Mapper` by name; the text as it is has no edits. `work`: a folder for them."""

    def __init__(self, variants: Mapping[str, Edits], work: Path) -> None:
        shutil.copytree(EXAMPLES / "drone", work / "drone")
        folder = work / "exploration"
        shutil.copytree(EXAMPLES / "exploration", folder)
        whole = (folder / "mapper.soter").read_text(encoding="utf-8")
        text, _, surveyor = whole.partition(SURVEYOR)
        assert surveyor, "who lets a corridor through stands no more behind Mapper"
        for k, edits in enumerate(variants.values()):
            node = ("node Mapper period", f"node Mapper{k} period")
            path = folder / f"mapper{k}.soter"
            path.write_text(edited(text, [*edits, node]), encoding="utf-8")
        numbers = range(len(variants))
        main = folder / "mappers.soter"
        imports = "\n".join(f'import "mapper{k}.soter" as mapper{k};' for k in numbers)
        nodes = " ".join(f"node mapper{k}.Mapper{k};" for k in numbers)
        main.write_text(SENSOR.format(imports=imports, nodes=nodes), encoding="utf-8")
        checked = check_file(str(main))
        assert checked.ok, checked.diagnostics.items
        assert checked.program is not None
        self.constants: dict[str, Any] = {n: c.value for n, c in checked.program.consts.items()}
        unit = generate(system_of(checked, "Main", {}))
        glue = "".join(STEP.format(k=k, p=unit.prefix) for k in numbers)
        source = f"{unit.source}\n#include <string.h>\n{glue}"
        openings = "\n".join(OPENING.format(k=k) for k in numbers)
        built = library(
            replace(
                unit,
                source=source.replace("bool soter_step_0", f"{openings}\nbool soter_step_0", 1),
            ),
            "-O1",
        )
        self._ffi: Any = FFI()
        self._ffi.cdef(openings)
        opened: Any = self._ffi.dlopen(str(built))
        self._steps = {
            name: getattr(opened, f"soter_step_{k}")
            for name, k in zip(variants, numbers, strict=True)
        }

    def step(
        self,
        name: str,
        ranges: NDArray[np.float64],
        newest: int,
        pose: Sequence[float],
        before: NDArray[np.bool_],
    ) -> tuple[NDArray[np.bool_], bool]:
        """The map after one scan, (n, n), and whether there is doubt.

        ranges: one a ray, m. pose: x, y, m, and the velocity, m/s. before: the map before, (n, n).
        """
        cells = before.astype(np.uint8)
        r, p = np.ascontiguousarray(ranges), np.array(pose, dtype=float)
        doubt = self._ffi.new("bool *")
        done = self._steps[name](
            self._ffi.cast("double *", r.ctypes.data),
            newest,
            self._ffi.cast("double *", p.ctypes.data),
            self._ffi.cast("uint8_t *", cells.ctypes.data),
            doubt,
        )
        assert done, "Mapper faults"
        return cells.astype(bool), bool(doubt[0])
