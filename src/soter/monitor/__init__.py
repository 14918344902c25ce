"""Judges whether what a robot did is what its proof assumes (`model_membership.py`).

For logs of other systems `log_survey.py` says what one holds, `typed_samples.py` reads by a
mapping, `log_replay.py` runs decision modules on it, and `log_judgement.py` has the results.
"""
