"""What tells one robot cell from another, and in what two of them differ."""
