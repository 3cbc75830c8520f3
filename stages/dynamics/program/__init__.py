"""The convex program of eqs. (7) and (8), from samples to matrices A_k for a given mixture, warp and P.

::

    samples ─ gram ─> regression ─ scaling ─> conic (Clarabel) ─ sharpen ─> solve: Solution
"""
