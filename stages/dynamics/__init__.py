"""Stable dynamical systems learned from demonstrations: paper eqs. (6)-(8).

::

    qlf, pqlf, warped ─> choose (learn, search, follow) ─> fit ─> LpvDs + certificate
                                   │
                                program/: A_k for a given mixture, warp and P

What a learned system is: `lpvds.py`, `kernels.py`, `warp.py`. Why it may be trusted: `certificate.py`.
"""
