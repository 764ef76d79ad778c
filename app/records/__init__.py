"""What an experiment consists of and what it comes down to: frozen records and the quantities
that people read. No files, no devices.
"""
