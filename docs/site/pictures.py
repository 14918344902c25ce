"""Take the pictures of docs/img that are of pages which commands write.

    .venv/bin/python docs/site/pictures.py [NAME...]      all of them, or those whose file is named

Purpose: run the command, open its page in a headless browser, cut out the parts that are named.
Non-goals: diagrams of programs (`soter show`); pages by themselves.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

import browser  # noqa: E402 - needs the path

PICTURES = {
    "report.png": ("examples/drone/demo.py --seconds 30", 1280, ".top, .arms, .arms + .key"),
    "proof.png": (
        "-m soter.cli.main verify examples/wall/cart.soter --report",
        760,
        ".top h1, .key:has(+ .figures), .figures",
    ),
    "mountain_car.png": ("examples/mountain_car/figure.py", 1120, ".plot-container"),
}
"""Of each the command, the width of the window in px, and which elements of the page it shows."""
AROUND_PX = 24
BOX = (
    "(() => {{ const boxes = [...document.querySelectorAll('{}')].map("
    "(e) => e.getBoundingClientRect()); return [Math.min(...boxes.map((b) => b.top)),"
    "Math.max(...boxes.map((b) => b.bottom))].map((y) => y + scrollY); }})()"
)
APART = "document.querySelectorAll('{}').forEach((e) => e.toggleAttribute('data-kept', true))"
REST = (
    "document.querySelectorAll('main *').forEach((e) => { if (!e.closest('[data-kept]') && "
    "!e.querySelector('[data-kept]')) e.remove(); })"
)
"""What stands between two elements that are shown is left out."""


def take(name: str, folder: Path) -> Path:
    """Make a page and its picture; the path of the picture."""
    command, width, shown = PICTURES[name]
    made = folder / f"{name}.html"
    ends_with_option = command.endswith("--report")
    line = [sys.executable, *command.split(), *([] if ends_with_option else ["-o"]), str(made)]
    subprocess.run(line, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    target = ROOT / "docs" / "img" / name
    with browser.page() as page:
        page.size(width, 1000)
        page.scheme("light")
        page.open(made.as_uri())
        page.wait(f"document.readyState === 'complete' && !!document.querySelector('{shown}')")
        page.value(APART.format(shown))
        page.value(REST)
        top, bottom = page.value(BOX.format(shown))
        y, height = max(top - AROUND_PX, 0), bottom - top + 2 * AROUND_PX
        page.picture(target, {"x": 0, "y": y, "width": width, "height": height, "scale": 1})
    return target


def main() -> int:
    """Take them and say how large they are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="files of docs/img")
    with tempfile.TemporaryDirectory() as folder:
        for name in parser.parse_args().names or PICTURES:
            path = take(name, Path(folder))
            print(f"{path.relative_to(ROOT)}  {path.stat().st_size:,} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
