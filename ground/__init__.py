"""What all packages stand on: lazy faces, and loops that are compiled once and kept on disk."""
