"""How long an editor waits for diagnostics after a keystroke.

    .venv/bin/python bench/newcomers/keystrokes.py [--keystrokes N]

Purpose: issue 15's "<= 150 ms median for a 1,000-line program", with a real client over standard
input and output: from the moment a key is sent to the moment the diagnostics of that very text
have arrived. Three texts: a file of 1,000 lines (the cart and its module twelve times under other
names), the largest example with all it imports, and the cart. Keys are typed into an expression in
the middle and removed again, so nearly all of the texts have a mistake. A pause follows each key.
`processor`: what the server computes for a key, whatever else the machine does meanwhile.
Non-goals: how long an editor takes to draw them.
"""

from __future__ import annotations

import argparse
import re
import statistics
import sys
import tempfile
import time
from os import sysconf
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from editor_client import Editor, editor  # noqa: E402 - from tests/
from soter.report.terminal_tables import table  # noqa: E402

TARGET_MS = 150.0
COPIES = 12
PAUSE_S = 0.05
WORD = " + WALLS_"
NAMES = re.compile(
    r"\b(A|WALL|FAST|Motion|motion|goal|accel|Cart|Fast|Careful|Clear|Need|Room|SafeCart|Protected"
    r"|Unprotected)\b"
)


def thousand_lines() -> str:
    """The cart again and again: every copy has names of its own."""
    cart = (ROOT / "examples" / "wall" / "cart.soter").read_text(encoding="utf-8")
    body = cart.removeprefix("soter 1;\n")
    copies = [NAMES.sub(rf"\1_{k}", body).replace(" default {", " {") for k in range(COPIES)]
    text = "soter 1;\n" + "".join(copies)
    assert len(text.splitlines()) >= 1000, len(text.splitlines())
    return text


def processor_s(pid: int) -> float:
    """Seconds of processor time that a process has used (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / sysconf("SC_CLK_TCK")


def waits(client: Editor, path: Path, text: str, near: str, keystrokes: int) -> list[float]:
    """Seconds from key to diagnostics, key by key, behind the place in the middle called `near`."""
    uri, diagnostics = client.checked(path, text)
    assert not [d for d in diagnostics if d.severity == 1], diagnostics
    at = text.index(near, len(text) // 2) + len(near)
    steps = [WORD[:n] for n in (*range(1, len(WORD) + 1), *range(len(WORD) - 1, -1, -1))]
    times = []
    for k in range(keystrokes):
        typed = text[:at] + steps[k % len(steps)] + text[at:]
        begin = time.perf_counter()
        version = client.type(uri, typed)
        client.diagnostics(uri, version)
        times.append(time.perf_counter() - begin)
        time.sleep(PAUSE_S)
    client.close(uri)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keystrokes", type=int, default=200)
    keystrokes = parser.parse_args().keystrokes
    drone = ROOT / "examples" / "drone" / "corridor.soter"
    wall = ROOT / "examples" / "wall" / "cart.soter"
    rows = []
    with tempfile.TemporaryDirectory() as folder, editor(Path(folder)) as client:
        big = Path(folder) / "thousand.soter"
        for name, path, text, near in (
            ("1,000 lines, twelve modules", big, thousand_lines(), "let v = max("),
            ("corridor.soter and its imports", drone, drone.read_text(encoding="utf-8"), "return "),
            ("cart.soter", wall, wall.read_text(encoding="utf-8"), "let v = max("),
        ):
            before = processor_s(client.server)
            took = sorted(1000 * t for t in waits(client, path, text, near, keystrokes))
            used = 1000 * (processor_s(client.server) - before) / (keystrokes + 1)
            rows.append(
                (
                    name,
                    str(len(text.splitlines())),
                    f"{statistics.median(took):.0f} ms",
                    f"{took[int(0.95 * len(took))]:.0f} ms",
                    f"{used:.0f} ms",
                )
            )
    print(f"{keystrokes} keystrokes each, diagnostics of the very text; target {TARGET_MS:.0f} ms")
    print(table(("text", "lines", "median", "95 of 100 within", "processor"), rows, color=False))


if __name__ == "__main__":
    main()
