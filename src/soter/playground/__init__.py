"""Soter in a browser: a page that checks, lays out, explains and runs, without a network."""
