"""The emulated bus from Python: a process that is started, given faults, read and ended.

It imports the standard library only, so that a program under test shares nothing with it.
"""
