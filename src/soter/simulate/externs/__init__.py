"""Loads and calls externs, the parts of a system whose code is not in Soter's language.

- `callables.py` loads the code that answers each extern of a run.
- `python_extern.py` loads and calls Python, `c_extern.py` calls C from the interpreter.
- `python_answers.py` lets Python answer a compiled program.
- `extern_process.py` runs a node in a process of its own, in virtual or in real time.
- `binding_warnings.py` warns of files that lack the code of a binding, and runs nothing.
"""
