"""A command line of soter, and what it executed: `python audited_command.py NOTES WORDS...`.

Purpose: the events that Python tells its audit hooks, written into the file NOTES, a JSON list a
line: programs that are started, libraries that are loaded, Python files that are executed and files
that are opened for writing, of this process and of all that it forks.
Non-goals: what C code does; judging (`tests/correct/test_what_runs.py`, `hostile_files.py`).
"""

from __future__ import annotations

import json
import os
import sys

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
CHANGES = frozenset(
    {"os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.symlink", "os.link", "os.truncate"}
)


def listen(notes: str) -> None:
    """Write down what happens from here on; opened anew, as workers close what they inherit."""
    place = os.path.realpath(notes)
    seen: set[tuple[str, ...]] = set()
    busy = [False]

    def told(event: str, given: tuple[object, ...]) -> None:
        if busy[0]:
            return
        busy[0] = True
        try:
            what = _what(event, given)
            if what and what not in seen:
                seen.add(what)
                to = os.open(place, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
                os.write(to, json.dumps(what).encode() + b"\n")
                os.close(to)
        finally:
            busy[0] = False

    sys.addaudithook(told)


def _what(event: str, given: tuple[object, ...]) -> tuple[str, ...]:
    """What an event is about, in texts; () for those that nobody asks about."""
    if event in ("subprocess.Popen", "os.exec", "os.posix_spawn"):
        words = given[1]
        return ("starts", *map(os.fsdecode, words if isinstance(words, (list, tuple)) else [words]))
    if event == "os.system":
        return ("starts", os.fsdecode(given[0]))  # type: ignore[arg-type]
    if event == "exec":
        return ("executes", str(getattr(given[0], "co_filename", "?")))
    if event == "ctypes.dlopen":
        return ("loads", str(given[0]))
    if event in CHANGES:
        return ("writes", *(os.fsdecode(g) for g in given if isinstance(g, (str, bytes))))
    if event == "open" and isinstance(given[2], int) and isinstance(given[0], (str, bytes)):
        kind = "writes" if given[2] & WRITES else "reads"
        return (kind, os.path.realpath(os.fsdecode(given[0])))
    return ()


if __name__ == "__main__":
    from soter.cli.main import main

    listen(sys.argv[1])
    sys.argv[1:] = sys.argv[2:]
    sys.exit(main())
