"""From frames to results: one frame in, one snapshot out, and what a drive comes down to. No
threads of its own, no devices, no files.
"""
