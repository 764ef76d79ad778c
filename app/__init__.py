"""The program: commands, settings, engine, session files, window, reports."""
