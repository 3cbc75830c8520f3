"""A diffeomorphism of the state, psi: under it a motion that bends away from its goal becomes one that approaches it.

T is a chain of Gaussian translations x <- x + v exp(-(rho |x - c|)^2), and psi(z) = T(z) - T(0) with z = x - x_g, so
that the goal stays where it is. A translation moves points along v by at most |v|, and its slope along v is at least
1 - |v| rho sqrt(2/e): below 1 it is one-to-one and smooth both ways, and so is the chain. That is what `bound` proves.
Perrin and Schlehuber-Caissier ("Fast diffeomorphic matching to learn globally asymptotically stable nonlinear dynamical
systems", Systems & Control Letters 96, 2016). No translation at all is the identity, the paper's own case. Not here:
which translations straighten a demonstration (`straighten.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.errors import DataError
from stages.compiled import compiled, lean
from stages.trajectory import Array, frozen

STEEPEST = math.sqrt(2.0 / math.e)
"""Largest slope of exp(-s^2): of a translation by v, rho |v| times this is the largest slope along v."""

_SOURCE = "dynamics"
# exp(-40) is 4e-18: beyond, a translation does not change a state that it does not dwarf.
_FAR = 40.0
# A step of Newton's that is smaller is rounding: at the last bit, neighbours would take turns for ever.
_ROUNDING = 4e-15
_MOST_ITERATIONS = 80


@dataclass(frozen=True, kw_only=True, eq=False)
class Warp:
    """psi(z) = T_M(... T_1(z)) - T(0), T_m(y) = y + v_m exp(-(rho_m |y - c_m|)^2).

    Attributes:
        centres: array, shape (M, d), c_m, metres, relative to the goal.
        translations: array, shape (M, d), v_m, metres.
        rates: array, shape (M,), rho_m, 1/m.

    Raises:
        DataError: shapes do not fit, a number is not finite, or a translation is not one-to-one.
    """

    centres: Array
    translations: Array
    rates: Array

    def __post_init__(self) -> None:
        for name in ("centres", "translations", "rates"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        shape = self.centres.shape
        if len(shape) != 2 or self.translations.shape != shape or self.rates.shape != shape[:1]:
            raise DataError(
                _SOURCE,
                f"a warp's centres, translations and rates must have shapes (M, d), (M, d), (M,), not {shape}, "
                f"{self.translations.shape}, {self.rates.shape}.",
            )
        if not all(np.isfinite(values).all() for values in (self.centres, self.translations, self.rates)):
            raise DataError(_SOURCE, "a warp must be finite.")
        with np.errstate(over="ignore", under="ignore"):
            sharpness = self.rates**2
        if not np.isfinite(sharpness).all():
            raise DataError(_SOURCE, "a warp's rates must be numbers whose squares are finite, too.")
        if not self.bound < 1.0:
            raise DataError(_SOURCE, f"a warp must be one-to-one: its steepest slope is {self.bound:.6g}, not below 1.")

    @classmethod
    def identity(cls, dimension: int) -> Warp:
        """The warp that changes nothing."""
        return cls(centres=np.empty((0, dimension)), translations=np.empty((0, dimension)), rates=np.empty(0))

    @property
    def count(self) -> int:
        """M, the number of translations; 0: the identity."""
        return int(self.rates.shape[0])

    @property
    def bound(self) -> float:
        """max |v_m| rho_m sqrt(2/e), rounded up: below 1, every T_m is one-to-one, and psi a diffeomorphism."""
        if not self.count:
            return 0.0
        # Relative to the largest entry, squares neither overflow nor vanish. Quotients, squares, sum, root and products
        # round d + 8 times at most; the factor is many times that.
        largest = np.abs(self.translations).max(axis=1)
        relative = self.translations / np.where(largest > 0.0, largest, 1.0)[:, None]
        with np.errstate(over="ignore"):
            slopes = np.sqrt((relative**2).sum(axis=1)) * largest * np.abs(self.rates) * STEEPEST
        return float(slopes.max()) * (1.0 + 1e-13)

    def origin(self) -> Array:
        """T(0), array, shape (d,), metres, as the compiled evaluation computes it, so that psi(0) is exactly 0."""
        d = self.centres.shape[1]
        result = np.empty(d)
        warp_at(
            np.zeros(d), self.centres, self.translations, self.rates, np.zeros(d), result, np.empty((d, d)), np.empty(d)
        )
        return frozen(result)

    def apply(self, z: Array) -> tuple[Array, Array]:
        """Return psi, shape (n, d), metres, and its Jacobian, shape (n, d, d), at z = x - x_g, shape (n, d), metres."""
        z = np.ascontiguousarray(z, dtype=np.float64)
        n, d = z.shape
        image, jacobian = np.empty((n, d)), np.empty((n, d, d))
        warp_all(z, self.centres, self.translations, self.rates, self.origin(), image, jacobian)
        return image, jacobian

    def invert(self, image: Array) -> Array:
        """Return z = psi^-1, shape (n, d), metres, of images, shape (n, d), metres."""
        image = np.ascontiguousarray(image, dtype=np.float64)
        result = np.empty_like(image)
        unwarp_all(image, self.centres, self.translations, self.rates, self.origin(), result)
        return result


@lean
def warp_at(
    z: Array,
    centres: Array,
    translations: Array,
    rates: Array,
    origin: Array,
    image: Array,
    jacobian: Array,
    row: Array,
) -> None:
    """Write psi(z), shape (d,), into `image` and its Jacobian, shape (d, d), into `jacobian`. `row`, (d,): scratch.

    `z`: shape (d,), metres. `centres`, `translations`, `rates`: of `Warp`. `origin`: T(0), shape (d,), metres.
    """
    d = z.shape[0]
    for i in range(d):
        image[i] = z[i]
        for j in range(d):
            jacobian[i, j] = 1.0 if i == j else 0.0
    for m in range(rates.shape[0]):
        squared = 0.0
        for i in range(d):
            squared += (image[i] - centres[m, i]) ** 2
        sharpness = rates[m] * rates[m]
        if sharpness * squared > _FAR:
            continue
        weight = math.exp(-sharpness * squared)
        # dT = I - 2 rho^2 weight v (y - c)', so the Jacobian gains v times a row.
        for j in range(d):
            row[j] = 0.0
            for i in range(d):
                row[j] += (image[i] - centres[m, i]) * jacobian[i, j]
            row[j] *= -2.0 * sharpness * weight
        for i in range(d):
            image[i] += weight * translations[m, i]
            for j in range(d):
                jacobian[i, j] += translations[m, i] * row[j]
    for i in range(d):
        image[i] -= origin[i]


@lean
def image_at(z: Array, centres: Array, translations: Array, rates: Array, origin: Array, image: Array) -> None:
    """As `warp_at`, without the Jacobian; the same image to the last bit."""
    d = z.shape[0]
    for i in range(d):
        image[i] = z[i]
    for m in range(rates.shape[0]):
        squared = 0.0
        for i in range(d):
            squared += (image[i] - centres[m, i]) ** 2
        sharpness = rates[m] * rates[m]
        if sharpness * squared > _FAR:
            continue
        weight = math.exp(-sharpness * squared)
        for i in range(d):
            image[i] += weight * translations[m, i]
    for i in range(d):
        image[i] -= origin[i]


@lean
def unwarp_at(image: Array, centres: Array, translations: Array, rates: Array, origin: Array, z: Array) -> None:
    """Write psi^-1(image), shape (d,), metres, into `z`, shape (d,): the translations are undone from the last.

    y = x + s v with s = exp(-(rho |y - s v - c|)^2) in [0, 1]: one equation in s, rising, by Newton with bisection.
    `image`: shape (d,), metres. `centres`, `translations`, `rates`: of `Warp`. `origin`: T(0), shape (d,), metres.
    """
    d = image.shape[0]
    for i in range(d):
        z[i] = image[i] + origin[i]
    for back in range(rates.shape[0]):
        m = rates.shape[0] - 1 - back
        # |y - s v - c|^2 = away - 2 s along + s^2 length
        away, along, length = 0.0, 0.0, 0.0
        for i in range(d):
            gap = z[i] - centres[m, i]
            away += gap * gap
            along += gap * translations[m, i]
            length += translations[m, i] * translations[m, i]
        sharpness = rates[m] * rates[m]
        nearest = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        if sharpness * (away + nearest * (nearest * length - 2.0 * along)) > _FAR:
            continue
        low, high = 0.0, 1.0
        s = math.exp(-sharpness * away)
        for _ in range(_MOST_ITERATIONS):
            weight = math.exp(-sharpness * (away + s * (s * length - 2.0 * along)))
            excess = s - weight
            if excess > 0.0:
                high = s
            else:
                low = s
            slope = 1.0 + 2.0 * weight * sharpness * (s * length - along)
            following = s - excess / slope
            if not low <= following <= high:
                following = 0.5 * (low + high)
            moved = abs(following - s)
            s = following
            if moved <= _ROUNDING:
                break
        for i in range(d):
            z[i] -= s * translations[m, i]


@compiled
def warp_all(
    z: Array, centres: Array, translations: Array, rates: Array, origin: Array, image: Array, jacobian: Array
) -> None:
    """Write psi and its Jacobian at z, shape (n, d), metres, into `image`, (n, d), and `jacobian`, (n, d, d)."""
    row = np.empty(z.shape[1])
    for t in range(z.shape[0]):
        warp_at(z[t], centres, translations, rates, origin, image[t], jacobian[t], row)


@compiled
def unwarp_all(image: Array, centres: Array, translations: Array, rates: Array, origin: Array, z: Array) -> None:
    """Write psi^-1 of images, shape (n, d), metres, into `z`, shape (n, d)."""
    for t in range(image.shape[0]):
        unwarp_at(image[t], centres, translations, rates, origin, z[t])
