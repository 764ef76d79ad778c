"""What is left when a run has ended: the numbers with their uncertainties, and one picture."""
