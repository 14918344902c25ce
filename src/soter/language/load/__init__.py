"""Reads the files of a program: sources, imports, data.

`named_files.py` reads any file that a user names; `loader.py` reads a program with its imports and
data; `identified_data.py` tells which data were fitted to logs.
"""
