"""A rerun recording of roll-outs, with a layout of its own, as a file. What `clpv inspect` writes.

rerun is imported here when the first recording is made. Not here: which roll-outs (`shown.py`), and the viewer
(`viewer.py`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import DataError
from pipeline.store import replacing
from stages.inspect import arms, arms_layout, plane, plane_layout
from stages.inspect.about import about
from stages.inspect.obstacles import draw_obstacles
from stages.inspect.shown import Shown
from stages.inspect.stream import PLANAR, TIMELINE, Stream

APPLICATION = "clpv"
"""What the viewer groups recordings by, and remembers layouts for."""


def write_recording(path: Path, shown: Sequence[Shown]) -> int:
    """Write roll-outs as one recording, on one time line, and return the file's size in bytes.

    The file appears whole or not at all. Raises StoreError where it cannot be written, DataError where rerun cannot be
    imported.
    """
    rr, rrb = rerun()

    def entity(parts: Sequence[str]) -> str:
        return str(rr.new_entity_path(list(parts)))

    title = ", ".join(dict.fromkeys(one.model[0] for one in shown))
    with replacing(path) as temporary:
        temporary.touch()  # what cannot be written is known before rerun tries
        to = rr.RecordingStream(APPLICATION, recording_id=identity(shown), send_properties=False)
        to.save(temporary, default_blueprint=_blueprint(rrb, shown, entity))
        try:
            to.send_recording_name(title if len(shown) > 1 else "/".join(shown[0].root))
            _draw(Stream(rr=rr, to=to), shown, entity)
        finally:
            to.flush()
            to.disconnect()
    return path.stat().st_size


def rerun() -> tuple[Any, Any]:
    """The modules rerun and rerun.blueprint. Raises DataError where they are not installed."""
    try:
        import rerun
        import rerun.blueprint
    except ImportError:
        raise DataError("rerun-sdk", "is not installed, and recordings need it: 'pip install rerun-sdk'.") from None
    return rerun, rerun.blueprint


def identity(shown: Sequence[Shown]) -> str:
    """A name for what is shown, the same for the same results: the viewer tells recordings apart by it."""
    parts = [f"{'/'.join(one.root)} {one.point.files['rollouts'].name}" for one in shown]  # named by its digest
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _draw(stream: Stream, shown: Sequence[Shown], entity: Any) -> None:
    """Models and scenes once, then every roll-out."""
    points = [one for one in shown if not one.carries]
    for model in dict.fromkeys(one.model[:-1] for one in points if one.rollout.x.shape[1] == PLANAR):
        stream.still(entity(model), stream.rr.Transform3D(scale=plane.UPWARDS))
    for model, one in {one.model: one for one in points}.items():
        plane.draw_model(stream, entity(model), one.point)
    for scene in dict.fromkeys(one.scene for one in points if one.scene):
        there = [one for one in points if one.scene == scene]
        longest = max((one.rollout.time for one in there), key=len)
        draw_obstacles(stream, entity(scene), there[0].point.scenes[there[0].rollout.scene], longest)
    carried = [one for one in shown if one.carries]
    for one in carried:
        arms.draw_carry(stream, entity(one.root), one, meshes=len(carried) <= arms.MESHED)
    for one in points:
        plane.draw_rollout(stream, entity(one.root), one)
    text = stream.rr.TextDocument(about(shown), media_type=stream.rr.MediaType.MARKDOWN)
    stream.still("about", text)


def _blueprint(rrb: Any, shown: Sequence[Shown], entity: Any) -> Any:
    """Pictures and plots, what they show in words, and the time line."""
    parts = []
    for layout, some in (
        (arms_layout.layout, [one for one in shown if one.carries]),
        (plane_layout.layout, [one for one in shown if not one.carries]),
    ):
        if some:
            parts.append(layout(rrb, some, entity))
    parts.append(rrb.TextDocumentView(origin="about", name="about"))
    return rrb.Blueprint(
        rrb.Tabs(*parts, active_tab=0),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", loop_mode="All"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
