"""Metrics of roll-outs: paper eq. (26) and dynamic time warping."""
