"""The commands, one module each: ``NAME``, ``SUMMARY``, ``EXAMPLES``, ``add_options``, ``run``."""
