"""One image: its file, samples of the part's edges in it, and scans across them."""
