"""Boards that sample forces and trigger a camera."""
