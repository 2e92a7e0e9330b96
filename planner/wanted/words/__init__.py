"""How pages, tables and names speak of what is wanted."""
