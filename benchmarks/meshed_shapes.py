"""How ventricles of many shapes are meshed from two surfaces, and whether they inflate.

    python benchmarks/meshed_shapes.py results/shapes --each 8 --inflate 2
    python benchmarks/meshed_shapes.py results/hearts --folder hearts --septum 0 0 -1 --inflate 12

The first draws ventricles of each of the `shapes.KINDS`; the second takes all pairs `*endo.stl` and
`*epi.stl` of a folder. Into the results go `shapes.csv`, a row per ventricle, and `shapes.md`, a
row per kind. Meshes are those of the default configuration; inflation, to the default pressure at
theta = 1 and at four corners of the parameter box, is that of config/hidden_effects.yaml's mesh.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import config as study_config
from regional_lv.errors import InputError
from regional_lv.geometry.from_surfaces import mesh_surfaces
from regional_lv.geometry.mesh import read_mesh
from regional_lv.inputs.physics import physics_of
from regional_lv.mechanics.continuation import Effort, NotConverged, Solver
from regional_lv.mechanics.simulator import Simulator
from regional_lv.verification.shapes import SIDES, shapes

CONFIG = Path(__file__).parents[1] / "config"
CORNERS = 4


def drawn(each, seed):
    """(kind, section `geometry.surfaces`) of drawn ventricles."""
    for shape in shapes(each, seed):
        with tempfile.TemporaryDirectory() as folder:
            yield shape.kind, shape.write(Path(folder))


def found(folder, septum):
    """(folder's name, section `geometry.surfaces`) of pairs of files."""
    for endocardium in sorted(folder.glob("*endo.stl")):
        files = (endocardium, endocardium.with_name(endocardium.name.replace("endo", "epi")))
        yield (
            folder.name,
            dict(zip(SIDES, map(str, files), strict=True))
            | {
                "unit": "mm",
                "septum": septum,
            },
        )


def meshed(section, config, folder):
    """Summary of the mesh, which becomes mesh.vtu in the folder."""
    files = ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json")
    paths = [folder / name for name in files]
    ends = (section[side] for side in SIDES)
    mesh_surfaces(*ends, section, config["mesh"], config["fibres"], *paths)
    return json.loads(paths[-1].read_text())


def inflations(mesh, config, seed):
    """Whether each of theta = 1 and `CORNERS` corners of the box can be inflated."""
    simulator = Simulator(mesh, physics_of(config))
    low, high = config["design"]["lower"], config["design"]["upper"]
    count = len(simulator.parameters.names)
    rng = np.random.default_rng(seed)
    thetas = [np.ones(count), *np.where(rng.random((CORNERS, count)) < 0.5, low, high)]
    done = []
    for theta in thetas:
        try:
            Solver(simulator, config["solver"]).inflate(
                theta, config["loading"]["pressure_mmhg"], Effort()
            )
            done.append(True)
        except NotConverged:
            done.append(False)
    return done


def row(kind, section, config, coarse, inflate, seed):
    """What became of one ventricle."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            summary = meshed(section, config, Path(folder))
        except InputError as error:
            return {"kind": kind, "meshed": False, "says": str(error)}
        fit = summary["fit_mm"]
        result = {
            "kind": kind,
            "meshed": True,
            "cavity_ml": summary["cavity_volume_ml"],
            "wall_ml": summary["wall_volume_ml"],
            "thinnest_segment_mm": summary["segment_thickness_mm"]["least"],
            "fit_max_mm": max(fit[f"{side}_max"] for side in SIDES),
            "fit_rms_mm": max(fit[f"{side}_rms"] for side in SIDES),
            "cavity_off_percent": summary["volume_deviation_percent"]["cavity"],
            "wall_off_percent": summary["volume_deviation_percent"]["wall"],
            "scaled_jacobian": summary["scaled_jacobian_min"],
            "worst_segment": summary["worst_segment"],
        }
        if inflate:
            meshed(section, coarse, Path(folder))
            states = inflations(read_mesh(Path(folder) / "mesh.vtu"), coarse, seed)
            result |= {"inflated_at_1": states[0], "inflated_corners": sum(states[1:])}
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--each", type=int, default=8, help="ventricles of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="take pairs of files instead")
    parser.add_argument("--septum", type=float, nargs=3, help="its direction in the folder's files")
    parser.add_argument("--inflate", type=int, default=0, help="so many of each kind, too")
    given = parser.parse_args()
    given.results.mkdir(parents=True, exist_ok=True)
    config = study_config.load({"study": "shapes"})
    coarse = study_config.load(CONFIG / "hidden_effects.yaml")
    cases = found(given.folder, given.septum) if given.folder else drawn(given.each, given.seed)
    rows, count = [], {}
    for kind, section in cases:
        count[kind] = count.get(kind, 0) + 1
        inflate = count[kind] <= given.inflate
        rows.append(row(kind, section, config, coarse, inflate, len(rows)))
        print(len(rows), rows[-1], flush=True)
        table = pd.DataFrame(rows)
        table.to_csv(given.results / "shapes.csv", index=False, float_format="%.5g")
    (given.results / "shapes.md").write_text(summary_of(table))


def summary_of(table):
    """Markdown: a row per kind."""
    lines = [
        "| kind | ventricles | meshed | cavity (mL) | thinnest segment (mm) | farthest (mm) | "
        "rms (mm) | cavity off (%) | wall off (%) | smallest scaled Jacobian | inflated |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for kind, own in table.groupby("kind", sort=False):
        fine = own[own["meshed"]]
        tried = fine.dropna(subset="inflated_at_1") if "inflated_at_1" in fine else fine[:0]
        done = (
            int(tried["inflated_at_1"].sum() + tried["inflated_corners"].sum()) if len(tried) else 0
        )
        lines.append(
            f"| {kind} | {len(own)} | {len(fine)} "
            f"| {fine['cavity_ml'].min():.0f} to {fine['cavity_ml'].max():.0f} "
            f"| {fine['thinnest_segment_mm'].min():.1f} | {fine['fit_max_mm'].max():.2f} "
            f"| {fine['fit_rms_mm'].max():.2f} | {fine['cavity_off_percent'].abs().max():.2f} "
            f"| {fine['wall_off_percent'].abs().max():.2f} | {fine['scaled_jacobian'].min():.2f} "
            f"| {done} of {len(tried) * (CORNERS + 1)} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
