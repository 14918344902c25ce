"""Judges whether what a robot did is what its proof assumes (`model_membership.py`).

For the model monitor `linear_model.py` has the plants of a proof as matrices;
`emitted_monitors.py` writes the monitor as a node that checks in flight; `identification.py` fits
parameters until it explains recorded episodes.

For logs of other systems `log_survey.py` says what one holds, `survey_drafts.py` drafts first files
of a program from that, `typed_samples.py` reads by a mapping, `derived_signals.py` adds slopes,
`decidable_modules.py` says which modules a log decides, `topics_heard.py` whether a read is young
enough, `doubtful_topics.py` which topics are in doubt, `log_replay.py` runs their decision modules
on it, `module_watch.py` notes what each decided, `predicate_margins.py` tells how far they were
from changing, and `log_judgement.py` has the results.
"""
