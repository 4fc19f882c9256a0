"""Benchmarks: ``python -m benchmarks [name ...]``. Nothing here is timed by a test."""
