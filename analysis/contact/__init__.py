"""The apparent contact: registration, background difference, centre, radius, ring means."""
