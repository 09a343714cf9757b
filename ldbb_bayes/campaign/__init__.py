"""Circular tests, campaigns and plans, and the files in which they are stored."""
