"""Gaussian mixtures over position: paper eq. (5) and ref. [32]."""
