"""Calibrations of a bench and its sample: each a protocol, the data of its runs, a fit, and a
certificate that settings name.
"""
