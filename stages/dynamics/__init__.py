"""Stable dynamical systems learned from demonstrations: paper eqs. (6)-(8)."""
