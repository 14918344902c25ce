"""Expressions over Arb balls."""
