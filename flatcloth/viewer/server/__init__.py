"""The web server: one port for the page, its messages, and viser behind a relay.

Input: a mode. Output: a running server.
"""
