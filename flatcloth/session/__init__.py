"""The operator's decisions: document, commands, state machine, and the journal on disk.

Input: commands and answers. Output: documents, and a session folder that survives a crash.
"""
