"""The program: commands, settings, the live bench, session files, window, reports."""
