"""Files that one version of Soter writes, for later ones to read: a folder of the corpus.

    PYTHONPATH=TREE/src python tests/compatibility/make_corpus.py TREE FOLDER

Purpose: once a release, by its own tree: programs and mappings are its examples; certificates,
traces, folders of campaigns, a log, times and JSON documents are what its commands write about
them. Everything lies where the next file looks for it, and nothing says on which machine it was.
Non-goals: reading any of it (`test_files_of_released_versions.py`); every example.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLES = (
    *("wall/*.soter", "wall/*.csv", "wall/rush.zip", "testing/*.soter", "gallery/*.soter"),
    *("generality/*.soter", "evidence/*.*", "fleet/*.soter", "fleet/*.toml", "fleet/msg/*.msg"),
    *("mavlink/*.soter", "mavlink/*.toml", "ros/*.soter", "ros/*.toml"),
    *("mountain_car/cliff.soter", "mountain_car/SafeCarSC.npy", "drone/px4_goto.*"),
    *("drone/goto.soter", "drone/city.soter", "drone/utopia.json", "drone/iris.soter"),
    *("drone/motion_primitive.soter", "rest/*.soter", "robots/*.soter"),
)
SMALL = Path(__file__).with_name("small.soter")
"""A module that is proved on a grid in a second."""
VIOLATED = ("late_sc", "two_modules_greedy", "three_modules_stubborn")
CART = "programs/wall/cart.soter"
COMMANDS = {
    "check": f"check {CART}",
    "verify": "verify programs/small.soter --cert certificates/small",
    "verify-induction": "verify programs/testing/planner.soter --cert certificates/planner",
    "recheck": "recheck certificates/small",
    "run": f"run {CART} --until 2s --log logs/cart.mcap",
    "campaign": f"campaign {CART} --flights 4 --until 5s --arms ac,paper -o campaigns/cart",
    "measure": f"measure {CART} --until 1s --samples 100 -o times/cart.json",
    "monitor": f"monitor {CART} logs/cart.mcap",
    **{f"test-{n}": f"test programs/testing/{n}.soter --time 30 -o traces" for n in VIOLATED},
    "replay": "replay traces/late_sc-Late.trace.json",
    "build": "build programs/wall/remote.soter --target posix -o package",
}
"""What is asked, by the name of the document that it gives; beside it lies what it wrote."""
CHANNELS = "channels/remote.json"
"""All that is kept of a package."""
UNREAD = ("campaigns/**/campaign.lock", "traces/*.html", ".soter", "package")


def main() -> int:
    """Write the folder; what a command ends with is not judged: it is a part of its document."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("tree", type=Path, help="the repository of the version")
    parser.add_argument("folder", type=Path, help="where to write, such as 0.1.0")
    args = parser.parse_args()
    for pattern in EXAMPLES:
        for path in sorted((args.tree / "examples").glob(pattern)):
            copy = args.folder / "programs" / path.relative_to(args.tree / "examples")
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
    shutil.copyfile(SMALL, args.folder / "programs" / SMALL.name)
    for name in ("certificates", "documents", "logs", "times"):
        (args.folder / name).mkdir(exist_ok=True)
    for name, command in COMMANDS.items():
        text = asked(args.folder, *command.split())
        (args.folder / "documents" / f"{name}.json").write_text(text, encoding="utf-8")
    write_hashes(args.folder)
    (args.folder / "channels").mkdir(exist_ok=True)
    shutil.copyfile(args.folder / "package" / "channels.json", args.folder / CHANNELS)
    for pattern in UNREAD:
        for path in args.folder.glob(pattern):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return 0


def asked(folder: Path, *words: str) -> str:
    """The document of a command."""
    words = (sys.executable, "-m", "soter", *words, "--json")
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    sys.stdout.write(f"{done.returncode} {' '.join(words[3:6])}\n")
    return done.stdout


def write_hashes(folder: Path) -> None:
    """`programs.json`: the hash of every program that is right; some are parts of others."""
    programs = sorted(p.relative_to(folder).as_posix() for p in folder.glob("programs/**/*.soter"))
    checked = json.loads(asked(folder, "check", *programs))["files"]
    hashes = {entry["file"]: entry["program_sha256"] for entry in checked if entry["exit"] == 0}
    (folder / "programs.json").write_text(json.dumps(hashes, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
