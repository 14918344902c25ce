"""Learned policies in files: reading them, asking them, and writing them as Soter or C.

Files of Stable-Baselines3 are read here without torch, pickles as data: nothing of a file is
imported or called.
"""
