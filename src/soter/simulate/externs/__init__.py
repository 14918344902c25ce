"""Loads and calls externs, the parts of a system that are somebody else's code.

- `callables.py` loads the code that answers each extern of a run.
- `python_extern.py` loads and calls Python, `c_extern.py` calls C from the interpreter.
- `python_answers.py` lets Python answer a compiled program.
- `extern_process.py` runs a node in a process of its own, in virtual or in real time.
- `binding_warnings.py` warns of files that do not hold what they should, and runs nothing.
"""
