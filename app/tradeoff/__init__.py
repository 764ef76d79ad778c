"""Speed against accuracy, measured on this computer: of the correlation for a texture and its
noise, of the inversion, and of the simulation.
"""
