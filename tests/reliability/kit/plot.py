"""A small SVG: one panel per series over a common axis."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

_WIDTH, _PANEL, _LEFT, _RIGHT, _GAP = 720, 110, 70, 15, 28


@dataclass(frozen=True)
class Series:
    """One panel."""

    name: str
    values: list[float]


def write_svg(path: Path, x_name: str, x: list[float], panels: list[Series]) -> None:
    """Writes the panels one below the other. Each begins at zero."""
    height = _GAP + len(panels) * (_PANEL + _GAP) + 14
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif" font-size="12">',
        f'<rect width="{_WIDTH}" height="{height}" fill="white"/>',
    ]
    right = max(x) or 1
    for n, panel in enumerate(panels):
        top = _GAP + n * (_PANEL + _GAP)
        bottom, most = top + _PANEL, max(panel.values) * 1.1 or 1
        points = " ".join(
            f"{_LEFT + (_WIDTH - _LEFT - _RIGHT) * a / right:.1f},{bottom - _PANEL * b / most:.1f}"
            for a, b in zip(x, panel.values, strict=True)
        )
        parts += [
            f'<text x="{_LEFT}" y="{top - 6}" font-weight="bold">{escape(panel.name)}</text>',
            f'<path d="M{_LEFT},{top}V{bottom}H{_WIDTH - _RIGHT}" fill="none" stroke="#888"/>',
            f'<text x="{_LEFT - 6}" y="{bottom}" text-anchor="end">0</text>',
            f'<text x="{_LEFT - 6}" y="{top + 10}" text-anchor="end">{most:.3g}</text>',
            f'<polyline points="{points}" fill="none" stroke="#1f5fa8" stroke-width="1.5"/>',
        ]
    parts += [
        f'<text x="{_LEFT}" y="{height - 6}">0</text>',
        f'<text x="{_WIDTH - _RIGHT}" y="{height - 6}" text-anchor="end">{right:.0f} {escape(x_name)}</text>',
        "</svg>",
    ]
    path.write_text("\n".join(parts) + "\n")
