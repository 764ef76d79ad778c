"""Emulated devices: the real drivers talk to them on a bench without hardware, and they show the
simulated world.
"""
