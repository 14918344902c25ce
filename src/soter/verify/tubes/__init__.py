"""Decision modules that enclose, in flight, every run of SC from the present estimate."""
