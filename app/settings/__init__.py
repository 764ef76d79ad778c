"""What a user may ask for: the sections of settings, the steps of a protocol, their text files."""
