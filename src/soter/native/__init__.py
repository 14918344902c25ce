"""Native code: find a compiler, build, cache by content, load; what externs are bound to.

In reading order:
- `extern_bindings.py` finds what answers each extern: Python, C or a learned policy.
- `compiler.py` finds a C compiler, and runs it within bounds.
- `cache.py` keeps what was built by its content; `shared_library.py` compiles and
  keeps generated C; `c_interface.py` opens it, and is the one file that knows cffi;
  `loaded_program.py` runs it on a state.
- `kept_state.py` finds whether C of externs may keep state between calls.
- `stack_bound.py` bounds the stack of a package from the compiler's figures.
"""
