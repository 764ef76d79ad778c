"""The live bench: the threads from the devices to the disk and to the analysis, the motion of the
stage, and a stop that comes first.
"""
