"""What the program needs of the computer: disk, standard streams, logs, priorities, stopping, and
the errors that are told to a user.
"""
