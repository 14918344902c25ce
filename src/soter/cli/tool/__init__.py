"""Commands about the tool itself, its texts and pictures: they neither run nor prove anything.

- `show.py` draws a system, or prints its Core; `explain.py` prints the page of a code.
- `fmt.py` gives programs one layout; `cache.py` shows and clears what is kept on the disk.
- `completion.py` writes the scripts by which shells complete command lines.
- `robot_kinds.py`: the robots of `soter new --robot`, with figures of one's own.
"""
