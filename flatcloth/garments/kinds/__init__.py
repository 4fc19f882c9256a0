"""The known kinds of garments, one module each with its ``KIND``; a new module is found by itself."""
