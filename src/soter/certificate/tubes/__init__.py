"""Modules with `rest`: a tube in Arb for what their decision modules decide in flight."""
