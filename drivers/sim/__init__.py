"""A simulated bench: one deterministic world on the sample clock, and the three devices that
observe it.
"""
