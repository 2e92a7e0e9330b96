"""Other poses that inspect the same as a setting, for a robot that does not reach the setting's own."""
