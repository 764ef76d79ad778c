"""Live runs from settings: where bench, analysis and session file are put together."""
