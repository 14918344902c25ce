"""Execution times: whether the thread of the trusted part can keep its calendar.

`trusted_thread.py` computes the latest start and end of every step, or says what is missing.
"""
