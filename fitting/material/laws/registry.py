"""The laws that can be fitted by name, with their numbers of terms."""

from collections.abc import Callable
from typing import NamedTuple

from fitting.material.laws.ogden_parameters import OgdenFamily
from fitting.statistics.parameters import AbstractFamily, Constant, Family
from suas_jax.constitutive import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Polynomial,
    Yeoh,
)

_DEGREES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))


def _free(name: str, degree: tuple[int, int]) -> Constant:
    return Constant(name, "free", "Pa", degree, (-0.3, 0.3))


def _mooney_rivlin(terms: int) -> AbstractFamily:
    parts = (Constant("C1"), _free("C2", (0, 1)), _free("C3", (0, 2)))[:terms]
    return Family("mooney-rivlin", parts, MooneyRivlin, modulus_is_sum=terms > 1)


def _yeoh(terms: int) -> AbstractFamily:
    parts = (Constant("C1"), _free("C2", (2, 0)), _free("C3", (3, 0)))[:terms]
    return Family("yeoh", parts, Yeoh)


def _polynomial(degree: int) -> AbstractFamily:
    chosen = [(i, j) for i, j in _DEGREES if i + j <= degree]
    parts = tuple(_free(f"C{i}{j}", (i, j)) for i, j in chosen[1:])
    return Family("polynomial", (Constant("C10"), *parts), Polynomial, modulus_is_sum=True)


def _fixed(*parts: Constant, law: str, build: Callable) -> Callable[[int], AbstractFamily]:
    return lambda terms: Family(law, parts, build)


class Choice(NamedTuple):
    """A law that can be asked for by name.

    Attributes:
        build: family from the number of terms (polynomial: the degree).
        usual: number of terms if none is asked for.
        most: largest number of terms.
    """

    build: Callable[[int], AbstractFamily]
    usual: int = 1
    most: int = 1


CHOICES: dict[str, Choice] = {
    "neo-hookean": Choice(_fixed(Constant("mu"), law="neo-hookean", build=NeoHookean)),
    "mooney-rivlin": Choice(_mooney_rivlin, 3, 3),
    "yeoh": Choice(_yeoh, 3, 3),
    "ogden": Choice(OgdenFamily, 3, 6),
    "gent": Choice(
        _fixed(
            Constant("mu"),
            Constant("Jm", "above I1", "1", start=(-4.0, 2.0)),
            law="gent",
            build=Gent,
        )
    ),
    "arruda-boyce": Choice(
        _fixed(
            Constant("mu"),
            Constant("lambda_m", "positive", "1", start=(0.2, 3.0)),
            law="arruda-boyce",
            build=ArrudaBoyce,
        )
    ),
    "polynomial": Choice(_polynomial, 2, 3),
}


def family(law: str, terms: int | None = None) -> AbstractFamily:
    """Choose a law by name.

    Args:
        law: a value of `law` in [material].
        terms: number of terms (Ogden 1 to 6, Mooney-Rivlin and Yeoh 1 to 3 constants) or
            degree (polynomial 1 to 3); None takes the usual number.

    Raises:
        ValueError: the law is unknown or has no such number of terms.
    """
    if law not in CHOICES:
        raise ValueError(f"--law {law}: unknown law; allowed: auto, {', '.join(CHOICES)}")
    choice = CHOICES[law]
    count = choice.usual if terms is None else terms
    if not 1 <= count <= choice.most:
        allowed = "1" if choice.most == 1 else f"1 to {choice.most}"
        raise ValueError(f"--terms {count}: {law} allows {allowed}")
    return choice.build(count)
