"""Computed predicates, the check of the DM that flies, and proofs of deployed systems.

- `missing_predicates.py` computes `ttf` and `safer` of modules that declare neither.
- `level_tables.py` writes them as expressions over tables; `shield_tables.py` does so for shields.
- `dm_check.py` compares the C of a DM with the switching logic; `dm_test_cases.py` has the cases.
- `proof_transfer.py` says which proof a deployed system takes over, `deployed_sensors.py` whether
  its sensors are as good as those of the proof.
"""
