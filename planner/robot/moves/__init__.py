"""How far an arm moves on without touching anything, from the distances at single joints."""
