"""Runs of systems, in virtual time on either engine or in real time, and their results."""
