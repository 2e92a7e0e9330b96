"""What is asked of a plan, as one value: what tells it from other requests, and in which words."""
