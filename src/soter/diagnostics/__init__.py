"""Spans, diagnostics, their rendering, and one page per code."""
