"""The figures of the paper from the results of several runs, and those that it could not have."""
