"""Whether what a robot did is what its proof assumes.

Logs of somebody else: `log_survey.py` says what one holds, `typed_samples.py` reads by a mapping,
`log_replay.py` runs decision modules on it, `log_judgement.py` is what is told.
"""
