"""Recorded experiments through the analysis: replays, further analyses, and their loop."""
