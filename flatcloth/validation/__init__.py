"""Proof of accuracy on the user's own cloth: a fabric printed with coded markers, and what it shows."""
