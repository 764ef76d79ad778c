"""Live runs from settings, and what every run, replay and analysis offers to who shows it."""
