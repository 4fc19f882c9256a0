"""The decisions of an operator: document, commands, state machine, and the journal on disk.

In: commands and answers. Out: documents; a session folder that survives a crash.
"""
