"""Line drawings as SVG: shapes in millimetres, labels in pixels, the same bytes each time."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

Point = Sequence[float]

# Okabe and Ito's colours, which colour-blind readers tell apart.
_STYLE = """
text { font: 15px system-ui, "DejaVu Sans", sans-serif; fill: #1a1a1a; }
.small { font-size: 13px; }
.title { font-weight: bold; }
.paper { fill: #ffffff; }
.membrane { fill: #0072b2; }
.film { fill: #f7dfa0; }
.wall { fill: #c9c9c9; }
.clamp { fill: #6b6b6b; }
.body { fill: #d9d9d9; stroke: #444444; stroke-width: 1.2; }
.skin { fill: #8dbfe0; stroke: #ffffff; stroke-width: 0.6; }
.patch { fill: #e8a06b; stroke: #d55e00; stroke-width: 1.5; }
.taxel { fill: #ffffff; stroke: #007a5e; stroke-width: 1.5; }
.strip { fill: none; stroke: #009e73; stroke-width: 5; }
.module { fill: #eef3f0; stroke: #888888; stroke-width: 0.8; }
.thin { fill: none; stroke: #444444; stroke-width: 1; }
.dashed { fill: none; stroke: #444444; stroke-width: 1; stroke-dasharray: 6 4; }
.load { fill: none; stroke: #d55e00; stroke-width: 2.5; }
.arc { fill: none; stroke: #a1447a; stroke-width: 3; }
.head { fill: #444444; stroke: none; }
.load-head { fill: #d55e00; stroke: none; }
.arc-head { fill: #a1447a; stroke: none; }
"""


def _n(value: float) -> str:
    """A coordinate, to a tenth of a pixel."""
    return f"{value + 0.0:.1f}".replace("-0.0", "0.0").removesuffix(".0")


class Drawing:
    """An SVG picture."""

    def __init__(
        self,
        title: str,  # what it shows, for readers who can't see it
        size: Point,  # of the picture [px]
        scale: float,  # pixels per millimetre
        origin: Point,  # where the origin lies, from the top left corner [px]
    ) -> None:
        self._title, self._size = title, size
        self.scale, self.origin = scale, origin
        self._parts: list[str] = []

    def pixel(self, place: Point) -> tuple[float, float]:
        """A place with y upwards [mm] in the picture [px]."""
        x, y = (float(c) for c in place)
        return self.origin[0] + self.scale * x, self.origin[1] - self.scale * y

    def _path(self, points: Iterable[Point]) -> str:
        return " ".join(",".join(map(_n, self.pixel(p))) for p in points)

    def area(self, points: Iterable[Point], kind: str) -> None:
        """A filled polygon."""
        self._parts.append(f'<polygon class="{kind}" points="{self._path(points)}"/>')

    def curve(self, points: Iterable[Point], kind: str = "thin") -> None:
        """A polyline."""
        self._parts.append(f'<polyline class="{kind}" points="{self._path(points)}"/>')

    def disc(self, centre: Point, radius: float, kind: str) -> None:
        """A circle; its radius in millimetres."""
        x, y = map(_n, self.pixel(centre))
        size = _n(self.scale * radius)
        self._parts.append(f'<circle class="{kind}" cx="{x}" cy="{y}" r="{size}"/>')

    def arrow(self, points: Sequence[Point], kind: str = "thin", *, both: bool = False) -> None:
        """A polyline with a head at its end, or at both."""
        self.curve(points, kind)
        self._head(points[-2], points[-1], kind)
        if both:
            self._head(points[1], points[0], kind)

    def _head(self, before: Point, tip: Point, kind: str) -> None:
        length = 10.0 if kind in ("load", "arc") else 7.0
        (x0, y0), (x, y) = self.pixel(before), self.pixel(tip)
        way = math.atan2(y - y0, x - x0)
        corners = [(x, y)]
        for turn in (2.75, -2.75):
            corners.append(
                (x + length * math.cos(way + turn), y + length * math.sin(way + turn))
            )
        style = f"{kind}-head" if kind in ("load", "arc") else "head"
        path = " ".join(",".join(map(_n, corner)) for corner in corners)
        self._parts.append(f'<polygon class="{style}" points="{path}"/>')

    def words(self, place: Point, text: str, where: str = "middle", kind: str = "") -> None:
        """A label; `where` the place is in it: its start, middle or end."""
        x, y = self.pixel(place)
        style = f' class="{kind}"' if kind else ""
        self._parts.append(
            f'<text{style} x="{_n(x)}" y="{_n(y + 5)}" text-anchor="{where}">{text}</text>'
        )

    def note(self, at: Point, place: Point, text: str, where: str = "middle") -> None:
        """A label with a line to what it names."""
        self.curve([at, place])
        gap = {"start": (5, 0), "end": (-5, 0), "middle": (0, 0)}[where]
        side = 0.0
        if where == "middle":
            side = 12.0 if place[1] > at[1] else -12.0
        moved = (place[0] + gap[0] / self.scale, place[1] + side / self.scale)
        self.words(moved, text, where)

    def write(self, file: Path) -> None:
        """Write the picture."""
        file.write_text(self.text(), encoding="utf-8")

    def text(self) -> str:
        """The picture as SVG."""
        width, height = map(_n, self._size)
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            f'width="{width}" height="{height}" role="img">'
        )
        paper = f'<rect class="paper" width="{width}" height="{height}"/>'
        head += f"\n<title>{self._title}</title>\n<style>{_STYLE}</style>\n{paper}"
        return "\n".join([head, *self._parts, "</svg>", ""])


def polar(radius: float, degrees: float | np.ndarray) -> np.ndarray:
    """Places around the axis: degrees from the y axis, positive towards +x [point, 2]."""
    angle = np.radians(degrees)
    return radius * np.stack([np.sin(angle), np.cos(angle)], -1)
