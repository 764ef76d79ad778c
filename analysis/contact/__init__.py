"""The apparent contact: rigid registration, background difference, centre, radius, means over
rings.
"""
