"""Plots and pictures, drawn by pyqtgraph."""
