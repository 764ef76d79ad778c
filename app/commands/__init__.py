"""What each command of `slipscope` does, once its arguments are read."""
