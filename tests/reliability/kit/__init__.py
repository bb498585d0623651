"""What the rows share: a daemon under test, its clients, its disk, and the faults that are injected into it."""
