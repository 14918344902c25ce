"""The prover: shows P2a, P2b and P3 of modules, and writes certificates (docs/verification.md).

In reading order:

- `command.py` is `soter verify` without a terminal: it has the modules proved, and writes the
  certificate. `chosen_modules.py` finds these modules, and their problems; `posed_problems.py`
  writes each problem as a text, for `soter diff`. `scope.py` says what the report covers;
  `proof_report.py` fills the record of its page; `proof_cache.py` keeps verdicts on this machine.
- `problem/` reads what is to be shown, and its times, off a flat system: a `Problem`.
- `verify_module.py` gives verdicts on one module over sets of states; its table has the method for
  each kind of problem. `proof_methods.py` writes its entry in a certificate.
- `enclose/` writes and runs C that encloses Core. `claims/` asks claims of groups of states.
- `grid/` (with `engine/`, in C) proves groups of states, on cells.
- `induction/` and `tubes/` prove whole modules: with z3; by tubes that SC's runs do not leave.
- Equal names: `problem/problem.py` has the `Problem` of every proof, `induction/problem.py` and
  `tubes/problem.py` make kinds of it for their methods. `claims/claims.py` asks all groups of a
  case; `grid/claims.py` answers for one group. Each `verify.py` gives the verdicts of its method.
- `refute.py` looks for runs of an `attacked_system.py` that leave C; `counterexample.py` keeps and
  replays them. `diagnosis/` tells why a claim is not proved, and which changes help.
- `period_advice.py` is `soter advise`: it tries other times. `find_sc.py` computes sets for open
  SCs; `synthesized_sc.py` makes their tables and text.
- `deploy/` makes and checks the DM that flies, and says which proof a deployed system inherits.
"""
