"""A run in processes of its own, which its window does not take with it: the bench (devices,
control, recorder), the analysis, and the supervisor that stops the stage should the bench die.
"""
