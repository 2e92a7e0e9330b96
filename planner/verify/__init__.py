"""What a setting or a plan promises, checked by doing it: displaced poses, pixels, measured lengths.

Poses are displaced, points projected and image coordinates rounded without the error model that made the promise.
"""
