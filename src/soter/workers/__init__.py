"""Child processes for extern controllers, and interruptible calls of solvers.

`child_process.py` asks a child process within a limited time, and ends processes that it left;
`exchange.py` has the byte layout of requests and answers of a worker in a real-time run;
`interruptible_solver.py` lets Ctrl-C interrupt z3.
"""
