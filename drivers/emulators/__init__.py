"""Emulated devices: what the real drivers talk to on a bench without hardware, looking at the
simulated world.
"""
