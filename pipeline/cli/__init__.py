"""The verbs of the command line, each a thin layer over the module that does the work.

A verb imports what it needs when it runs: `train` must load neither Drake nor Zenoh.
"""
