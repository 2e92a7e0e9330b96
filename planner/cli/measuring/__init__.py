"""The command ``measure``: its options, and what it does."""
