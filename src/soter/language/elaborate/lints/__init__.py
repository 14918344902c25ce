"""Warnings about systems that are well-formed, but hardly do what their author meant."""
