"""A thread beside which nobody forks.

Purpose: `forks_wait`: what another thread of this process forks waits until some work is done. A
lock of Python that a thread holds at a fork stays locked in the child for ever.
Non-goals: programs that are started (`subprocess` runs no Python in the child).
"""

from __future__ import annotations

import os
import threading

forks_wait = threading.Lock()
"""`with forks_wait:` around the work of a thread that is not the one that forks."""

if hasattr(os, "register_at_fork"):  # there is no fork on Windows
    os.register_at_fork(
        before=forks_wait.acquire,
        after_in_parent=forks_wait.release,
        after_in_child=forks_wait.release,
    )
