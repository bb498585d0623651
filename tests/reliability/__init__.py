"""Reliability of a carved program, attacked from outside: one module per row of `docs/reliability.md`."""
