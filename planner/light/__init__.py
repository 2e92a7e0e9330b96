"""Lamps for a plan: from where they make what each setting measures show, and how few places serve all settings."""
