"""Target `cortex-m`: an image without an operating system.

A board is a file (`runtime/cortex_m/boards/*.c`, or somebody's own); what is written for it is the
C package with start-up, linker script and a Makefile; where the tools are, an image is made of it.
"""
