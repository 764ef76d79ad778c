"""Cameras, and images in files that take the place of one."""
