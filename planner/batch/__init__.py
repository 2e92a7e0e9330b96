"""Plans for all parts of a folder, by processes of this machine or of many."""
