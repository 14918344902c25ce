"""Execution times: whether the thread of the trusted part can keep its calendar."""
