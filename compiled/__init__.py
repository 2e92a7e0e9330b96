"""Compiled loops on disk: their machine code is kept, and used again only where nothing it depends on has changed."""
