"""The course of an experiment as decisions on what was just measured: no threads, no devices, no
clock.
"""
