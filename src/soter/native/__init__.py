"""Native code: the compiler, the cache of libraries, loaded programs, bindings of externs.

In reading order:
- `extern_bindings.py` finds the code of each extern: Python, C or a learned policy.
- `compiler.py` finds a C compiler, and runs it within bounds.
- `cache.py` keeps built files by a hash of their inputs; `shared_library.py` compiles
  generated C; `c_interface.py` opens libraries, and is the only file that uses cffi;
  `loaded_program.py` runs a compiled program on a state.
- `kept_state.py` finds out whether C of externs may keep state between calls.
- `stack_bound.py` computes how much stack a package needs at most.
"""
