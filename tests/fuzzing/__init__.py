"""Damaged and hostile inputs for every format that flatcloth reads; see ``__main__``."""
