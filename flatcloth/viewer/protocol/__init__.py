"""What the page and the server say to each other.

In: messages, checked strictly. Out: the state of the page as plain JSON values.
"""
