"""Stages that pull the block."""
