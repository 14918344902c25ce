"""Target `posix`: a program in real time; the texts around it are templates in this folder."""
