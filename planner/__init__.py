"""Planning of sensor settings for active visual inspection."""
