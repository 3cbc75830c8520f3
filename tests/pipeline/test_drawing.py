"""Small plots as text: dots where the numbers are, never wider than the terminal, told apart without colours."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.braille import Style
from pipeline.drawing import draw
from pipeline.plots import Bar, Bars, Plot, Series

NAN, INF = float("nan"), float("inf")
ESCAPES = re.compile(r"\033\[[0-9;]*m")


def series(y, x=None, name="", **options):
    y = np.array(y, dtype=float)
    return Series(
        name=name, x=np.arange(y.size, dtype=float) if x is None else np.array(x, dtype=float), y=y, **options
    )


def plot(*lines, **options):
    return Plot(**{"title": "Title", "x_label": "t [s]", "y_label": "y [mm]", "series": lines} | options)


def text(*plots, width=40, **options):
    return "\n".join(draw(plots, Style(width=width, **options))) + "\n"


def picture(lines):
    """The rows between the axes, from the top, as wide as the axis below them."""
    plain = ESCAPES.sub("", lines).split("\n")
    (level, *_) = [len(line) for line in plain if re.match(r" *[└+]", line)]
    found = [line.ljust(level) for line in plain if re.match(r" *\S* [┤│|]", line)]
    return [re.split("[┤│|]", line, maxsplit=1)[1] for line in found]


RISING = """\
Title
y [mm]
3 ┤                                  ⣀⠔⠊
  │                               ⣀⠔⠊
  │                            ⣀⠔⠊
  │                         ⣀⠔⠊
  │                      ⡠⠔⠊
  │                  ⢀⡠⠒⠉
  │               ⣀⠤⠊⠁
  │            ⡠⠔⠊
  │         ⡠⠔⠉
  │      ⡠⠔⠉
  │   ⡠⠔⠉
0 ┤⡠⠔⠉
  └─────────────────────────────────────
   0               t [s]               3
"""

RISING_PLAINLY = """\
Title
y [mm]
3 |                                  ***
  |                               ***
  |                            ***
  |                         ***
  |                      ***
  |                  ****
  |               ****
  |            ***
  |         ***
  |      ***
  |   ***
0 |***
  +-------------------------------------
   0               t [s]               3
"""


def test_a_rising_line_rises():
    rows = picture(text(plot(series([0, 1, 2, 3]))))
    assert len(rows) == 12
    first = [len(row) - len(row.lstrip()) for row in rows]
    assert all(upper > lower for upper, lower in pairwise(first))
    assert rows[0].rstrip()[-1] == "\u280a"  # dots 2 and 4: the last column's uppermost dot is set
    assert len(rows[0]) == 37  # of 40: two for the axis, one for its values


def test_golden_pictures():
    assert text(plot(series([0, 1, 2, 3]))) == RISING
    assert text(plot(series([0, 1, 2, 3])), braille=False) == RISING_PLAINLY


def test_corners_hold_the_extremes():
    """A rectangle's corners are the corner dots of the picture: 1, 4, 7 and 8 of a braille character."""
    rows = picture(text(plot(series([0, 0, 1, 1], x=[0, 1, 0, 1], joined=False))))
    assert (rows[0][0], rows[0][-1]) == ("⠁", "⠈")
    assert (rows[-1][0], rows[-1][-1]) == ("⡀", "⢀")
    assert sum(cell not in " " for row in rows for cell in row) == 4


def test_a_gap_is_not_bridged():
    whole = picture(text(plot(series([0, 0, 1, 0, 0]))))
    broken = picture(text(plot(series([0, 0, 1, NAN, NAN, 0, 0]))))
    assert whole[5].strip()
    assert broken[-1].rstrip()[:3] == "⣀⣀⣀"
    assert len(broken[5].strip()) == 1  # the way up only


@pytest.mark.parametrize("values", [[], [NAN], [NAN, NAN], [INF, -INF]])
def test_nothing_to_draw(values):
    assert draw([plot(series(values, name="a"))], Style(width=80)) == []
    assert draw([], Style(width=80)) == []
    assert draw([Bars(title="t", bars=tuple(Bar(name="b", value=v) for v in values))], Style(width=80)) == []


def test_a_series_without_samples_is_not_in_the_legend():
    assert text(plot(series([0, 1], name="here"), series([NAN], name="gone"), same_scale=True)).endswith("a here\n")


def test_one_sample_stands_in_the_middle():
    found = text(plot(series([5.0], x=[2.0])))
    rows = picture(found)
    (at,) = [k for k, row in enumerate(rows) if row.strip()]
    assert at in (5, 6)
    assert len(rows[at].strip()) == 1
    assert found.split("\n")[2].startswith("5.25 ┤")
    assert "1.9 " in found
    assert found.rstrip().endswith(" 2.1")


@pytest.mark.parametrize("value", [0.0, -3.0, 1e-12, 1e9])
def test_constant_values_are_a_level_line(value):
    rows = picture(text(plot(series([value] * 5))))
    (drawn,) = [row for row in rows if row.strip()]
    assert len(set(drawn)) == 1


def test_ends_of_axes_are_rounded_to_what_is_between():
    found = text(plot(series([-43.217, 0.5], x=[0.0, 3.667])), width=60)
    assert "  0.5 ┤" in found
    assert "-43.2 ┤" in found
    assert found.rstrip().endswith(" 3.67")
    assert "-961.1 ┤" in text(plot(series([-961.12, -1032.9])))
    assert "1.235e+08 ┤" in text(plot(series([1.0, 1.23456e8])))
    assert "\n0.0002 ┤" in text(plot(series([0.0, 0.0002])))
    assert "-0 " not in text(plot(series([-1e-9, 1.0])))


def test_letters_tell_lines_apart():
    found = text(plot(series([0, 1], name="up"), series([1, 0], name="down"), series([0, 0], name="seen", faint=True)))
    assert found.endswith("a up   b down   ⠒⠒ seen\n")
    drawn = "".join(picture(found))
    assert drawn.count("a") == drawn.count("b") == 1
    plain = text(plot(series([0, 1], name="up"), series([1, 0], name="down")), braille=False)
    assert plain.endswith("a up   b down\n")
    assert {*"".join(picture(plain))} == {" ", "a", "b"}


def test_a_single_line_has_no_letter():
    found = text(plot(series([0, 1], name="only"), series([0.5], name="goal", x=[0.5], joined=False, mark="G")))
    assert found.endswith("⠒⠒ only   G goal\n")
    assert "".join(picture(found)).count("G") == 1
    assert "a" not in "".join(picture(found))


def test_a_letter_gives_way_to_a_sign():
    lines = [series([1, 1], name="one"), series([0, 0, 0], name="two")]
    signs = series([1, 1, 0], x=[0, 0.25, 1.5], joined=False, mark="o")
    drawn = picture(text(plot(*lines, signs)))
    assert "".join(drawn).count("o") == 3
    assert "".join(drawn).count("b") == 1


def test_dots_of_faint_points():
    found = text(plot(series([0, 1], name="seen", joined=False, faint=True)), braille=False)
    assert found.endswith(".. seen\n")
    assert {*"".join(picture(found))} == {" ", "."}


def test_on_one_scale_a_square_is_square():
    square = plot(series([0, 0, 1, 1, 0], x=[0, 1, 1, 0, 0]), same_scale=True)
    rows = picture(text(square, width=80))
    assert len(rows) == 12
    assert {len(row) for row in rows} == {24}  # 48 dots both ways
    assert rows[0] == "⡏" + "⠉" * 22 + "⢹"
    assert rows[-1] == "⣇" + "⣀" * 22 + "⣸"


def test_on_one_scale_a_flat_motion_takes_few_rows():
    rows = picture(text(plot(series([0, 1], x=[0, 20]), same_scale=True), width=60))
    assert len(rows) == 4
    tall = picture(text(plot(series([0, 20], x=[0, 1]), same_scale=True), width=60))
    assert (len(tall), len(tall[0].rstrip()) <= 24) == (12, True)


def test_narrow_pictures_stand_side_by_side_where_they_fit():
    square = plot(series([0, 1], x=[0, 1], name="line"), same_scale=True)
    assert text(square, square, width=80).split("\n")[0] == "Title" + " " * 25 + "Title"
    assert len(text(square, square, width=80).split("\n")) == 18
    below = text(square, square, width=50).split("\n")
    assert [k for k, line in enumerate(below) if line == "Title"] == [0, 18]
    assert below[17] == ""


def test_limits_for_comparison():
    half = plot(series([0, 1, 9], x=[0, 1, 9]), x_limits=(0, 2), y_limits=(0, 2))
    rows = picture(text(half))
    assert "".join(rows[:5]).strip() == ""
    assert rows[-1][0] != " "
    assert max(len(row.rstrip()) for row in rows) in (19, 20)


BARS = Bars(
    title="Share",
    bars=(Bar(name="all", value=1.0, text="4 of 4"), Bar(name="half", value=0.5), Bar(name="none", value=0.0)),
    full=1.0,
)


def test_golden_bars():
    assert text(BARS) == (
        "Share\nall   ⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶ 4 of 4\nhalf  ⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶ 0.5\nnone  0\n"
    ).replace("⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶ 0.5", "⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⣶⡆ 0.5")
    assert text(BARS, braille=False) == (
        "Share\nall   ########################### 4 of 4\nhalf  ############## 0.5\nnone  0\n"
    )


def test_bars_of_nothing_of_little_and_of_what_is_missing():
    bars = (Bar(name="a", value=1e6), Bar(name="b", value=1.0), Bar(name="c", value=NAN), Bar(name="d", value=-1.0))
    lines = text(Bars(title="t", bars=bars), width=60).split("\n")
    assert lines[2:5] == ["b  ⡆ 1", "c  -", "d  -1"]
    assert text(Bars(title="t", bars=(Bar(name="a", value=0.0),))) == "t\na  0\n"


def test_colours_only_where_they_are_wanted():
    plots = [plot(series([0, 1], name="up"), series([1, 0], name="down"), series([0, 0], faint=True)), BARS]
    plain, coloured = text(*plots), text(*plots, colours=True)
    assert "\033" not in plain
    assert {*re.findall(r"\033\[(\d+)m", coloured)} == {"36", "33", "2", "0"}
    assert ESCAPES.sub("", coloured) == plain


def test_nothing_in_a_terminal_of_fewer_than_40_columns():
    assert draw([BARS], Style(width=39)) == []
    assert draw([BARS], Style(width=40)) != []


numbers = st.floats(-1e160, 1e160) | st.sampled_from([NAN, INF, -INF, 0.0, 5e-324, 1.0, 1.0 + 1e-12])
names = st.text("abc ünd", max_size=90)
lines = st.lists(st.tuples(numbers, numbers), max_size=6).flatmap(
    lambda samples: st.builds(
        lambda name, joined, mark, faint: Series(
            name=name,
            x=np.array([x for x, _ in samples]),
            y=np.array([y for _, y in samples]),
            joined=joined,
            mark=mark,
            faint=faint,
        ),
        names,
        st.booleans(),
        st.sampled_from(["", "o"]),
        st.booleans(),
    )
)
plots = st.builds(
    Plot,
    title=names,
    x_label=names,
    y_label=names,
    series=st.lists(lines, max_size=4).map(tuple),
    same_scale=st.booleans(),
)
charts = st.builds(
    Bars,
    title=names,
    bars=st.lists(st.builds(Bar, name=names, value=numbers, text=names), max_size=4).map(tuple),
    full=st.none() | st.just(1.0),
)


@given(st.lists(plots | charts, max_size=4), st.integers(20, 140), st.booleans(), st.booleans())
def test_no_line_is_wider_than_the_terminal(many, width, braille, colours):
    for line in draw(many, Style(width=width, braille=braille, colours=colours)):
        assert "\n" not in line
        assert len(ESCAPES.sub("", line)) <= min(width, 100)
        if not braille:
            assert not set(line) - set("…") & set(map(chr, range(0x2800, 0x2900)))


@given(st.lists(st.integers(-1000, 1000), min_size=2, max_size=40))
def test_dots_are_where_the_numbers_are(values):
    """Each value's dot, in the row and column that its share of the extent asks for; and no dot elsewhere."""
    rows = picture(text(plot(series(values, joined=False)), width=60))
    low, high = min(values), max(values)
    if low == high:
        return
    cells = set()
    for k, value in enumerate(values):
        across = round(k / (len(values) - 1) * (2 * len(rows[0]) - 1))
        up = np.rint((value - low) / (high - low) * 47)
        cells.add((11 - int(up) // 4, across // 2))
    assert {(row, at) for row, line in enumerate(rows) for at, cell in enumerate(line) if cell != " "} == cells
