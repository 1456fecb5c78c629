"""A skin's section with its dimensions, as a picture for a page."""

import numpy as np
from markupsafe import Markup

from fitting.arrays import Floats
from fitting.datasheet.in_time import scene_of
from suas_jax.config import SkinSpec, continuous_inputs
from suas_jax.config.quantities import format_quantity
from suas_jax.figures.outline import Outline, outline
from suas_jax.scene.parts import skin_parts

_WIDTH, _MARGIN = 640.0, 78.0  # [px]
_CLAMP = 16.0  # side of a clamp [px]


class _Paper:
    """Pixels of places in metres, and what is drawn so far."""

    def __init__(self, drawn: Outline) -> None:
        self.low = drawn.outer.min(1)
        self.low[1] = min(self.low[1], drawn.wall.min(1)[1])
        self.high = drawn.outer.max(1)
        self.scale = (_WIDTH - 2 * _MARGIN) / (self.high[0] - self.low[0])
        self.height = 2 * _MARGIN + self.scale * (self.high[1] - self.low[1])
        self.parts: list[str] = []

    def at(self, place: Floats) -> Floats:
        """Pixels [2, *shape] of places [2, *shape]."""
        x, y = place
        return np.stack(
            [
                _MARGIN + (x - self.low[0]) * self.scale,
                self.height - _MARGIN - (y - self.low[1]) * self.scale,
            ]
        )

    def shape(self, points: Floats, style: str, kind: str = "polyline") -> None:
        """A polyline or a polygon through places [2, point] [m]."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in self.at(points).T)
        self.parts.append(f'<{kind} points="{text}" {style}/>')

    def line(self, a: Floats, b: Floats, style: str = 'stroke="#222"') -> None:
        """A line between pixels."""
        self.parts.append(
            f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" {style}/>'
        )

    def text(self, x: float, y: float, text: str, anchor: str = "middle") -> None:
        """A label at pixels; all of its text is made of numbers and known words."""
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>')

    def dimension(self, a: Floats, b: Floats, label: str) -> None:
        """A dimension line with arrows between pixels, its label beside it."""
        self.line(a, b, 'stroke="#222" marker-start="url(#arrow)" marker-end="url(#arrow)"')
        x, y = (np.asarray(a) + b) / 2
        upright = abs(a[0] - b[0]) < abs(a[1] - b[1])
        self.text(
            x + (6 if upright else 0),
            y + (0 if upright else -5),
            label,
            *(("start",) if upright else ()),
        )


def drawing(spec: SkinSpec) -> Markup:
    """The section with its dimensions as SVG.

    Args:
        spec: the skin, with electrodes.
    """
    drawn = outline(scene_of(spec))
    paper = _Paper(drawn)
    paper.shape(drawn.wall, 'fill="#d8d8d8" stroke="#777"', "polygon")
    film = np.concatenate([drawn.inner, drawn.wall[:, ::-1]], 1)
    paper.shape(film, 'fill="#f6e3ae" stroke="none"', "polygon")
    membrane = np.concatenate([drawn.inner, drawn.outer[:, ::-1]], 1)
    paper.shape(membrane, 'fill="#4c78a8" stroke="#1f3f5f" stroke-width="0.6"', "polygon")
    for end in (0, -1):
        x, y = paper.at((drawn.inner[:, end] + drawn.outer[:, end]) / 2)
        paper.parts.append(
            f'<rect x="{x - _CLAMP / 2:.1f}" y="{y:.1f}" width="{_CLAMP}" '
            f'height="{_CLAMP / 2}" fill="#555"/>'
        )
    _taxels(paper, drawn, spec)
    _dimensions(paper, drawn, spec)
    marker = (
        '<marker id="arrow" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="7" '
        'markerHeight="7" orient="auto-start-reverse"><path d="M0,1 L10,5 L0,9 z" '
        'fill="#222"/></marker>'
    )
    head = (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {paper.height:.0f}" width="{_WIDTH:.0f}" '
        'font-family="sans-serif" font-size="12" role="img" '
        'aria-label="Section of the skin with its dimensions">'
    )
    return Markup(f"{head}<defs>{marker}</defs>{''.join(paper.parts)}</svg>")


def _taxels(paper: _Paper, drawn: Outline, spec: SkinSpec) -> None:
    """Electrodes on the wall, as wide as they are; on a pad those of all rows together."""
    parts = skin_parts(spec, continuous_inputs(spec))
    own = parts.sensing().taxels
    angle, diameter = (np.asarray(x)[:, 0] for x in (own.angle, own.diameter))
    half = diameter / 2 / float(parts.geometry.wall_size[0])
    for a, h in sorted(
        {(round(float(a), 4), float(h)) for a, h in zip(angle, half, strict=True)}
    ):
        along = np.linspace(a - h, a + h, 5)
        place = np.stack([np.interp(along, drawn.angle, x) for x in drawn.wall])
        paper.shape(place, 'fill="none" stroke="#c44e00" stroke-width="3.5"')
    x, y = paper.at(drawn.wall.mean(1))
    paper.text(x, y - 9, "rigid wall")
    paper.parts.append(
        f'<text x="{x:.1f}" y="{y + 9:.1f}" text-anchor="middle" fill="#c44e00">'
        f"{len(angle)} taxels</text>"
    )


def _dimensions(paper: _Paper, drawn: Outline, spec: SkinSpec) -> None:
    left, right = drawn.inner[:, 0], drawn.inner[:, -1]
    base = paper.height - _MARGIN + 34
    a, b = (np.array([paper.at(x)[0], base]) for x in (left, right))
    for end, place in ((a, left), (b, right)):
        paper.line(paper.at(place), end + np.array([0, 6]), 'stroke="#999" stroke-width="0.6"')
    paper.dimension(a, b, _length(float(np.linalg.norm(right - left))) + " inside")
    crown = drawn.outer[:, drawn.outer[1].argmax()]
    side = _WIDTH - _MARGIN + 24
    low, high = (np.array([side, paper.at(x)[1]]) for x in (left, crown))
    paper.line(paper.at(crown), high + np.array([6, 0]), 'stroke="#999" stroke-width="0.6"')
    paper.dimension(low, high, _length(crown[1] - left[1]))
    middle = len(drawn.angle) // 2
    inner, outer, wall = (x[:, middle] for x in (drawn.inner, drawn.outer, drawn.wall))
    varies = [
        not isinstance(x, float) for x in (spec.geometry.thickness, spec.geometry.oil_gap)
    ]
    names = [
        name + " in the middle" * v for name, v in zip(("membrane", "oil"), varies, strict=True)
    ]
    for row, (ends, name) in enumerate(
        zip(((inner, outer), (wall, inner)), names, strict=True)
    ):
        place = paper.at(sum(ends) / 2)
        label = np.array([_MARGIN - 60, 18.0 + 17 * row])
        text = f"{name} {_length(float(np.linalg.norm(ends[1] - ends[0])))}"
        paper.text(label[0], label[1], text, "start")
        start = label + np.array([8.2 * len(text), -4])
        paper.line(start, place, 'stroke="#222" stroke-width="0.6"')
    arc = drawn.arc[-1] - drawn.arc[0]
    ends_are = "clamped" if spec.geometry.dimension == 3 else "sliding"
    paper.text(
        _WIDTH / 2,
        paper.height - 14,
        f"inner face {_length(float(arc))} along the arc; "
        f"{_length(float(spec.geometry.width))} along the axis, ends {ends_are}",
    )


def _length(value: float) -> str:
    return format_quantity(float(f"{value:.4g}"), "length")
