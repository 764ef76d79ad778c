"""Stick radius and onset of sliding."""
