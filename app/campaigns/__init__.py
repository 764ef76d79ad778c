"""Campaigns: runs of one bench over loads, velocities, samples and repeats, planned in a file,
checked before anything moves, taken up again after any interruption.
"""
