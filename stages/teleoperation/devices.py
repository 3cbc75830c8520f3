"""Keyboard and gamepad as masters: a point that keys or sticks move at a speed, by the events of pygame.

pygame is imported only when a master is made, and its events come from outside: from the small window of `open_window`,
or posted by a test.
"""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, Protocol

import numpy as np

from pipeline.errors import ParameterError, UsageError
from stages.teleoperation.mapping import MasterSample
from stages.teleoperation.masters import Seen
from stages.teleoperation.parameters import GamepadParameters, KeyboardParameters
from stages.trajectory import Array, frozen

LONGEST_TICK = 0.1
"""A tick moves the point no farther than in this time, s, however late it comes."""

AXES = (("forward", "back"), ("left", "right"), ("up", "down"))
"""What moves the point along +x and -x, +y and -y, +z and -z."""

UNTURNED = frozen([0.0, 0.0, 0.0, 1.0])

SIZE = (420, 40)
"""Width and least height of the window, pixels."""

LINE = 24
"""Height of a line of text in it, pixels."""


class EventSource(Protocol):
    """Where events come from: `pygame.event`, or the window of `open_window`."""

    def get(self) -> Sequence[Any]:
        """Return the events since the last call, and forget them."""
        ...


class _Device:
    """A point that is moved at a velocity, from the origin of the master's frame."""

    def __init__(self, events: EventSource) -> None:
        self._pygame, self._events = _pygame(), events
        self._position, self._time = np.zeros(3), math.inf
        self._clutch, self._done = False, False

    @property
    def done(self) -> bool:
        """Whether the operator has left, or closed the window."""
        return self._done

    def sample(self, time: float, seen: Seen) -> MasterSample:
        """Return where the point is at `time`, seconds, after the events until now."""
        # What was held since the last tick moves the point; events have no time of their own.
        self._position = self._position + min(max(time - self._time, 0.0), LONGEST_TICK) * self._velocity()
        self._time = time
        for event in self._events.get():
            if event.type == self._pygame.QUIT:
                self._done = True
            elif event.type == self._pygame.WINDOWFOCUSLOST:  # what is released from now on is not heard of
                self._let_go()
            else:
                self._take(event)
        return MasterSample(time, self._position, UNTURNED, self._clutch and not self._done)

    def _velocity(self) -> Array:
        """Array, shape (3,), m/s."""
        raise NotImplementedError

    def _take(self, event: Any) -> None:
        """Take in one event."""
        raise NotImplementedError

    def _let_go(self) -> None:
        """Forget everything that is held."""
        self._clutch = False


class Keyboard(_Device):
    """A `Master` that keys move."""

    def __init__(
        self, given: KeyboardParameters, events: EventSource, *, location: str = "teleoperation.master"
    ) -> None:
        """Listen to `events`, of a pygame that has been initialised; `location`: dotted place of the parameters.

        Raises UsageError where pygame is not installed, ParameterError where it knows no key of a name, or one key has
        two meanings.
        """
        super().__init__(events)
        self._given = given
        self._meaning: dict[int, str] = {}
        for role in (*chain(*AXES), "clutch", "slowly", "leave"):
            name = getattr(given, role)
            try:
                code = self._pygame.key.key_code(name)
            except ValueError:
                raise ParameterError(
                    f"{location}.{role}", f"there is no key {name!r}; keys are named as 'w', 'space', 'left shift'."
                ) from None
            if code in self._meaning:
                raise ParameterError(
                    f"{location}.{role}", f"{name!r} is already the key for {self._meaning[code]}; choose another."
                )
            self._meaning[code] = role
        self._held: set[str] = set()

    def _velocity(self) -> Array:
        along = np.array([(plus in self._held) - (minus in self._held) for plus, minus in AXES], dtype=np.float64)
        speed = self._given.speed * (self._given.slow if "slowly" in self._held else 1.0)
        return np.asarray(speed * along / max(math.sqrt(float(along @ along)), 1.0))

    def _take(self, event: Any) -> None:
        if event.type not in (self._pygame.KEYDOWN, self._pygame.KEYUP):
            return
        role = self._meaning.get(event.key, "")
        if event.type == self._pygame.KEYDOWN:
            self._held.add(role)
        else:
            self._held.discard(role)
        self._clutch, self._done = "clutch" in self._held, self._done or "leave" in self._held

    def _let_go(self) -> None:
        super()._let_go()
        self._held.clear()


class Gamepad(_Device):
    """A `Master` that two sticks move."""

    def __init__(
        self, given: GamepadParameters, events: EventSource, *, location: str = "teleoperation.master"
    ) -> None:
        """Listen to `events`, of a pygame that has been initialised; `location`: dotted place of the parameters.

        Raises UsageError where pygame is not installed, ParameterError where an axis or a button has two meanings.
        """
        super().__init__(events)
        self._given = given
        self._axes = (given.forward, given.left, given.up)
        if len(set(self._axes)) < 3:
            raise ParameterError(f"{location}.up", f"forward, left and up need three axes, not {list(self._axes)}.")
        if given.clutch == given.leave:
            raise ParameterError(f"{location}.leave", f"button {given.leave} is already the clutch; choose another.")
        self._deflection = np.zeros(3)

    def _velocity(self) -> Array:
        size, zone = np.abs(self._deflection), self._given.deadzone
        share = np.clip((size - zone) / (1.0 - zone), 0.0, 1.0)
        return np.asarray(-self._given.speed * np.sign(self._deflection) * share)

    def _take(self, event: Any) -> None:
        pygame = self._pygame
        if event.type == pygame.JOYAXISMOTION and event.axis in self._axes:
            self._deflection[self._axes.index(event.axis)] = event.value
        elif event.type in (pygame.JOYBUTTONDOWN, pygame.JOYBUTTONUP):
            pressed = event.type == pygame.JOYBUTTONDOWN
            if event.button == self._given.clutch:
                self._clutch = pressed
            elif event.button == self._given.leave:
                self._done = self._done or pressed
        elif event.type == pygame.JOYDEVICEREMOVED:
            self._let_go()

    def _let_go(self) -> None:
        super()._let_go()
        self._deflection[:] = 0.0


class Window:
    """A small window that shows what the keys do: an `EventSource`."""

    def __init__(self, pygame: Any, lines: Sequence[str]) -> None:
        """Open it with these lines of text; pygame has been initialised."""
        self._pygame, self._lines = pygame, lines
        self._font = pygame.font.Font(None, LINE)
        width = max([SIZE[0], *(self._font.size(line)[0] + LINE for line in lines)])
        self._surface = pygame.display.set_mode((width, SIZE[1] + LINE * len(lines)))
        pygame.display.set_caption("clpv teleop")
        self._draw()

    def get(self) -> Sequence[Any]:
        """Return the events since the last call; the text is drawn again where the window was uncovered."""
        events: Sequence[Any] = self._pygame.event.get()
        if any(event.type == self._pygame.WINDOWEXPOSED for event in events):
            self._draw()
        return events

    def _draw(self) -> None:
        self._surface.fill("black")
        for number, line in enumerate(self._lines):
            text = self._font.render(line, True, "white")
            self._surface.blit(text, (LINE // 2, SIZE[1] // 2 + LINE * number))
        self._pygame.display.flip()


def described(given: KeyboardParameters | GamepadParameters) -> tuple[str, ...]:
    """What keys or sticks do, a line each."""
    if isinstance(given, KeyboardParameters):
        return (
            f"hold {given.clutch}: the arms follow",
            *(f"{getattr(given, axis)}: {axis}" for axis in chain(*AXES)),
            f"hold {given.slowly}: {given.slow:g} of the speed",
            f"{given.leave}: end the demonstration",
        )
    return (
        f"hold button {given.clutch}: the arms follow",
        f"axis {given.forward}: forward, back",
        f"axis {given.left}: left, right",
        f"axis {given.up}: up, down",
        f"button {given.leave}: end the demonstration",
    )


UNSEEN = ("dummy", "offscreen")
"""Drivers of SDL that show nothing to nobody; it falls back to them by itself."""


@contextmanager
def open_window(given: KeyboardParameters | GamepadParameters) -> Iterator[Window]:
    """Initialise pygame, show what the keys do in a small window, hand out its events; at the end, all is closed.

    Raises UsageError where pygame is not installed, there is no display, or the gamepad is not connected.
    """
    pygame = _pygame()
    try:
        try:
            pygame.display.init()
            driver = pygame.display.get_driver()
            if driver in UNSEEN and os.environ.get("SDL_VIDEODRIVER") != driver:  # taken for want of a screen
                raise pygame.error("there is no display")
            pygame.font.init()
            window = Window(pygame, described(given))
        except pygame.error as error:
            raise UsageError(
                f"kind = {given.kind} needs a window, and none can be opened ({error}): run it on a desktop, or use "
                "kind = simulated."
            ) from None
        stick = _gamepad(pygame, given.device) if isinstance(given, GamepadParameters) else None
        yield window
        del stick  # its events came only as long as it was held
    finally:
        pygame.quit()


def _gamepad(pygame: Any, number: int) -> Any:
    pygame.joystick.init()
    count = pygame.joystick.get_count()
    if number >= count:
        raise UsageError(f"gamepad {number} is not there, {count} connected: connect it, or use kind = keyboard.")
    return pygame.joystick.Joystick(number)


def _pygame() -> Any:
    """The module, imported without its greeting; raises UsageError where it is not installed."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        return importlib.import_module("pygame")
    except ImportError:
        raise UsageError(
            "a keyboard or gamepad needs pygame, which is not installed: pip install 'clpv[teleop]'."
        ) from None
