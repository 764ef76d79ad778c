"""The session file: the only place where experiments are written to and read from disk."""
