"""Learned policies in files: what they say, what they answer, and as a function in Soter.

Files of Stable-Baselines3 are read here without torch, pickles as data: nothing of a file is
imported or called.
"""
