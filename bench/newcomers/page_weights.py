"""How long the playground takes from opening to a finished run, and what pages weigh.

    .venv/bin/python bench/newcomers/page_weights.py [--times N] [--pyodide PATH]

Purpose: the page is opened from a file in headless Chromium with no name to be resolved; it loads,
checks the cart and runs it for 30 s of its time. Told are the seconds to "ready" and to the end of
the run by this machine's clock, everything that was asked for, and the sizes of the page and of a
run's reports. Beside them the same run in CPython here, as the machine is shared: its load, too.
Non-goals: other browsers; Pyodide is fetched with npm unless it is given.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

import browser  # noqa: E402 - the tests' own
import soter  # noqa: E402 - as above
from soter.playground.session import PlaygroundSession  # noqa: E402 - as above
from soter.playground.write import write_playground  # noqa: E402 - as above

CART = ROOT / "examples" / "wall" / "cart.soter"
STACK = ROOT / "examples" / "drone" / "surveillance.soter"
TARGET_S, TARGET_KB = 10.0, 300.0


def opened(path: Path) -> tuple[float, float, float, list[str]]:
    """Seconds to ready, to the end of the run, of processors; the schemes of what was asked for."""
    with browser.page() as page:
        began, cpu = time.perf_counter(), page.cpu_s()
        page.open(f"{path.as_uri()}#run")
        page.wait("document.body?.dataset.ready === 'yes'", 600.0)
        ready = time.perf_counter() - began
        page.wait("document.body.dataset.ran !== undefined", 600.0)
        ran = time.perf_counter() - began
        return ready, ran, page.cpu_s() - cpu, sorted({r.partition(":")[0] for r in page.requests})


def in_cpython() -> float:
    """Seconds of the same run here."""
    session = PlaygroundSession(str(CART), CART.read_text(encoding="utf-8"))
    began = time.perf_counter()
    while '"done": true' not in session.advance(1.0):
        pass
    return time.perf_counter() - began


def weights(folder: Path) -> None:
    """Sizes of the reports of two runs."""
    for path, until in ((CART, "30s"), (STACK, "60s")):
        program = soter.load(path)
        run = program.simulate(until=until)
        alone = folder / f"{path.stem}-alone.html"
        beside = folder / "reports" / f"{path.stem}.html"
        program.write_report(run, beside)
        program.write_report(run, alone, self_contained=True)
        kb, whole = beside.stat().st_size / 1e3, alone.stat().st_size / 1e3
        print(
            f"report of {path.stem:13} {until:>4}: {kb:4.0f} KB beside the script "
            f"(target {TARGET_KB:.0f}), {whole:,.0f} KB self-contained"
        )
    (script,) = folder.glob("reports/soter-plotly-*.js")
    print(f"the script, once a folder: {script.stat().st_size / 1e3:,.0f} KB")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--pyodide", default=os.environ.get("SOTER_PYODIDE"))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        weights(folder)
        page = write_playground(folder / "page", given.pyodide)
        print(f"playground, one file: {page.stat().st_size / 1e6:.1f} MB")
        rows = []
        for _ in range(given.times):
            load = os.getloadavg()[0] / (os.cpu_count() or 1)
            rows.append((*opened(page), in_cpython(), load))
            ready, ran, cpu, asked, here, load = rows[-1]
            print(
                f"ready {ready:5.1f} s, cart run {ran:5.1f} s; the browser computed {cpu:4.1f} s; "
                f"CPython: {here:4.1f} s; load {load:.1f} a core; asked for: {', '.join(asked)}"
            )
        middle = statistics.median(r[1] for r in rows)
        print(f"from opening to a finished run: {middle:.1f} s median (target {TARGET_S:.0f})")


if __name__ == "__main__":
    main()
