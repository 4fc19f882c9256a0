"""The commands, a module each: ``NAME``, ``SUMMARY``, ``EXAMPLES``, ``add_options``, ``run``."""
