"""The web server: one port for the page, its messages, and viser behind a relay.

In: a mode. Out: a running server.
"""
