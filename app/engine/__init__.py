"""The engine: one run from devices to disk and screen, free of Qt and of files."""
