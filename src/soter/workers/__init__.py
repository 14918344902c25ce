"""Child processes for controllers that are somebody else's code, and for solvers.

`child_process.py` asks a child process within a limited time, and ends what it leaves behind;
`exchange.py` is the byte layout of what a worker in a real-time run is asked and answers;
`interruptible_solver.py` lets Ctrl-C interrupt z3.
"""
