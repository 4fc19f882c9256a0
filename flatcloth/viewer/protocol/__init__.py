"""The messages between the page and the server.

Input: messages, checked strictly. Output: the state of the page as plain JSON values.
"""
