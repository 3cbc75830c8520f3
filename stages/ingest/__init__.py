"""Recorded demonstrations in, one table of demonstrations out."""
