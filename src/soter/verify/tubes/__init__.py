"""Reach tubes of SC from an estimate: decision modules that prove themselves at run time."""
