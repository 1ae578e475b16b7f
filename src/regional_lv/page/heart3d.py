"""The heart in three dimensions, to turn in a browser."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex

from regional_lv import aha
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import heart, style

SUBDIVISION = 3
"""Straight-edged cells per edge of a quadratic element."""

COLOURS = "viridis"
"""Of stiffness, as on the bullseyes."""

CLEAR_MM = 4.0
"""From the wall to what is written beside it."""

LIFTED_MM = 0.25
"""Borders of segments above the wall, which would hide parts of them otherwise."""

WALLS = {"anterior": (1,), "septum": (2, 3), "inferior": (4,), "lateral": (5, 6)}
"""What is written around the base, and beside which segments."""

VIEW = (
    1.45 * np.cos(np.radians(heart.VIEW_ANGLE_DEG)),
    1.45 * np.sin(np.radians(heart.VIEW_ANGLE_DEG)),
    0.66,
)
"""Where the viewer stands at first, in the size of the heart; the light comes from there, too."""

HEIGHT = 560
FONT = "system-ui, sans-serif"


def html_label(name: str) -> str:
    """`C_a_free_wall` as HTML: factor with its index, and the zone."""
    letter, _, rest = name.partition("_")
    index, _, zone = rest.partition("_")
    factor = f"<i>{escape(letter)}</i><sub>{escape(index)}</sub>" if index else escape(letter)
    return f"{factor} {escape(style.zone_label(zone))}".strip()


def draw(
    mesh: str | Path,
    parameters: StiffnessInputs,
    medians: Mapping[str, float],
    hover: Sequence[str],
) -> str:
    """The wall as an HTML element that plotly's script fills (not part of it), to turn and zoom.

    mesh: VTU of the unloaded heart. Buttons colour it by zone or by the `medians` of a factor
    (parameter -> value). hover: the label of each segment (17), in plotly's HTML.
    """
    grid = heart.straight_cells(mesh, SUBDIVISION)
    surface = grid.extract_surface(algorithm="dataset_surface").triangulate()
    walls = _walls(surface, parameters, hover)
    fig = go.Figure([*walls, _borders(surface), _names(surface), _scale()])
    zone = [parameters.zone_of(s.number) for s in aha.SEGMENTS]
    norm = Normalize(*_limits(list(medians.values())))
    ways = {"zones": [parameters.colours[z] for z in zone]}
    for factor in parameters.factors:
        values = [medians[f"{factor}_{z}"] for z in zone]
        ways[factor] = [to_hex(colormaps[COLOURS](norm(value))) for value in values]
    fig.update_layout(
        height=HEIGHT,
        margin={"l": 0, "r": 0, "t": 44, "b": 0},
        paper_bgcolor="white",
        font={"family": FONT, "size": 13, "color": style.BLACK},
        legend={"orientation": "h", "x": 0.5, "xanchor": "center", "y": 0, "itemclick": False}
        | {"itemdoubleclick": False},
        hoverlabel={"align": "left", "bgcolor": "white", "font": {"family": FONT}},
        scene={
            "aspectmode": "data",
            "dragmode": "orbit",
            "domain": {"y": [0.06, 1]},
            "camera": _camera(),
            **{f"{axis}axis": {"visible": False} for axis in "xyz"},
        },
        coloraxis={
            "cmin": norm.vmin,
            "cmax": norm.vmax,
            "colorscale": [[x, to_hex(colormaps[COLOURS](x))] for x in np.linspace(0, 1, 11)],
            "showscale": False,
            "colorbar": {"thickness": 12, "len": 0.6, "x": 1, "xanchor": "right"},
        },
        updatemenus=[
            {
                "type": "buttons",
                "direction": "right",
                "x": 0.5,
                "xanchor": "center",
                "y": 1.0,
                "yanchor": "bottom",
                "buttons": [_button(way, colours, walls) for way, colours in ways.items()],
            }
        ],
    )
    return fig.to_html(
        full_html=False,
        include_plotlyjs=False,
        config={"displayModeBar": False, "responsive": True, "scrollZoom": False},
        div_id="heart",
    )


def _walls(surface, parameters: StiffnessInputs, hover: Sequence[str]) -> list[go.Mesh3d]:
    """A trace for each segment; the first one of each zone is in the legend."""
    traces, seen = [], set()
    for segment, says in zip(aha.SEGMENTS, hover, strict=True):
        points, faces = _of_segment(surface, segment.number)
        zone = parameters.zone_of(segment.number)
        traces.append(
            go.Mesh3d(
                **dict(zip("xyz", points.T.round(2), strict=True)),
                **dict(zip("ijk", faces.T, strict=True)),
                color=parameters.colours[zone],
                name=escape(style.zone_label(zone)),
                showlegend=zone not in seen and len(parameters.zones) < len(aha.SEGMENTS),
                hovertemplate=f"{says}<extra></extra>",
                lighting={"ambient": 0.7, "diffuse": 0.5, "specular": 0.05, "roughness": 0.9},
                lightposition={axis: 1e4 * at for axis, at in zip("xyz", VIEW, strict=True)},
            )
        )
        seen.add(zone)
    return traces


def _of_segment(surface, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and triangles (m, 3) of one segment's surface."""
    faces = surface.regular_faces[np.asarray(surface.cell_data["segment"]) == number]
    used, faces = np.unique(faces, return_inverse=True)
    return np.asarray(surface.points, dtype=np.float32)[used], faces.reshape(-1, 3).astype("int32")


def _borders(surface) -> go.Scatter3d:
    """Lines between the segments."""
    lifted = surface.compute_normals(cell_normals=False, split_vertices=False)
    ends = heart.borders_of(surface, "segment").lines.reshape(-1, 3)[:, 1:]
    points = (surface.points + LIFTED_MM * lifted.point_data["Normals"])[ends]
    # A gap after each line of two points.
    gapped = np.concatenate([points, np.full_like(points[:, :1], np.nan)], axis=1).reshape(-1, 3)
    return go.Scatter3d(
        **dict(zip("xyz", gapped.T.astype(np.float32).round(2), strict=True)),
        mode="lines",
        line={"color": "#222222", "width": 4},
        hoverinfo="skip",
        showlegend=False,
    )


def _names(surface) -> go.Scatter3d:
    """Numbers of the segments beside the epicardium, names of the walls around the base."""
    places, texts = [], []
    for segment in aha.SEGMENTS:
        points, _ = _of_segment(surface, segment.number)
        places.append(_beside(points, CLEAR_MM))
        texts.append(str(segment.number))
    for name, numbers in WALLS.items():
        points = np.concatenate([_of_segment(surface, n)[0] for n in numbers])
        places.append(_beside(points[points[:, 2] > points[:, 2].max() - 1], 4 * CLEAR_MM))
        texts.append(f"<b>{name}</b>")
    return go.Scatter3d(
        **dict(zip("xyz", np.transpose(places).astype(np.float32).round(2), strict=True)),
        mode="text",
        text=texts,
        textfont={"size": 13, "color": style.BLACK},
        hoverinfo="skip",
        showlegend=False,
    )


def _beside(points: np.ndarray, clear: float) -> np.ndarray:
    """A place (3,) outside a part of the wall: `clear` mm beside the middle of its outer surface,
    or below a part that lies all around the long axis."""
    radius = np.hypot(*points[:, :2].T)
    x, y = points[:, :2].mean(axis=0)
    low, high = points[:, 2].min(), points[:, 2].max()
    if np.hypot(x, y) < 0.3 * radius.max():
        return np.array([x, y, low - clear])
    height = (low + high) / 2
    off = np.abs(points[:, 2] - height)
    level = off <= max((high - low) / 4, 1.0, off.min())  # a large element has no node near it
    outer = (radius[level].max() + clear) / np.hypot(x, y)
    return np.array([outer * x, outer * y, height])


def _scale() -> go.Scatter3d:
    """Nothing to see, but what the colour scale belongs to."""
    return go.Scatter3d(
        **{key: [None] for key in "xyz"},
        mode="markers",
        marker={"color": [1.0], "coloraxis": "coloraxis"},
        hoverinfo="skip",
        showlegend=False,
    )


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """Round limits that hold all values: one scale for all factors."""
    return np.floor(4 * min(values)) / 4, np.ceil(4 * max(values)) / 4


def _camera() -> dict:
    """From a little above, where the still pictures are seen from."""
    x, y, z = VIEW
    return {"eye": {"x": x, "y": y, "z": z}, "up": {"x": 0, "y": 0, "z": 1}}


def _button(way: str, colours: Sequence[str], walls: Sequence[go.Mesh3d]) -> dict:
    """Colours all segments; of factors, shows the scale in place of the zones' names."""
    plain = way == "zones"
    label = "zones" if plain else html_label(way)
    return {
        "label": label,
        "method": "update",
        "args": [
            {"color": list(colours), "showlegend": [plain and bool(w.showlegend) for w in walls]},
            {"coloraxis.showscale": not plain, "coloraxis.colorbar.title.text": label},
            list(range(len(walls))),
        ],
    }
