"""The files of experiments: the only place where they are written to and read from disk."""
