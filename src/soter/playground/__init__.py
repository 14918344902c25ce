"""Soter in a browser: a page that checks, lays out, explains and runs, without a network.

`session.py` has the functions that the page calls in the browser, `write.py` packs the page (with
`assets/`) into one file, and `__main__.py` is the command for that.
"""
