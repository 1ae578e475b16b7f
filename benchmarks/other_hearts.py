"""The emulator of any heart on hearts that it never saw, as a user has them: segment tables of
other draws of the population, the paper's volunteer, and real hearts from surfaces.

    python benchmarks/other_hearts.py errors FOLDER [<heart>_endo.stl ...]
    python benchmarks/other_hearts.py cohort FOLDER [<heart>_endo.stl ...]
    python benchmarks/other_hearts.py planted FOLDER <heart>_endo.stl ...
    python benchmarks/other_hearts.py misread FOLDER <heart>_endo.stl ...
    regional-lv cohort FOLDER
    python benchmarks/other_hearts.py score FOLDER results/<name of FOLDER>/cohort/hearts.parquet

Beside each endocardium lies the epicardium, `<heart>_epi.stl` (mm, septum along -z, as in the
hearts of MESA in the Cardiac Atlas Project). Every heart has its own length and pressure.

`errors`: each is simulated at five stiffnesses, each with two causes on, on the mesh of the
emulator; those from surfaces on the mesh of these surfaces, of which the emulator only has the
table. FOLDER keeps the simulations (a Parquet a heart; one that is there is not simulated again,
for another emulator), what the emulator says of them (`looked_up`), and gets `errors.csv`: median
and rms of the absolute errors and what the stated 95 % intervals cover, by group of hearts. Hearts
out of its reach are counted.

`cohort`: of some hearts of each group (`OF_COHORT`), folders as of `regional-lv new`: measured by
one simulation on the default mesh, which is finer than the emulator's, with noise of 0.02 and 2 mL;
figures of the table are misread with a standard deviation of 0.5 mm. Some have an effect
(`PLANTED`), two a damaged file. `truth.csv` has what was simulated. `planted`: the same of the
hearts from surfaces alone, each with an effect (`EFFECTS` in turn). `misread`: these without an
effect, and with walls that are not as thick as the surfaces say (sd 1 mm, each segment by itself).
`score`: what the posteriors and verdicts make of it.
"""

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import config as study_config
from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.emulators.gaussian import Z95
from regional_lv.geometry.from_config import make_heart
from regional_lv.hearts import ONE_HEART, population
from regional_lv.hearts.file import shipped
from regional_lv.hearts.reach import OutOfReach, by_table, within
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.layout import HeartFiles

SEED = 57
WANTED = {"plain": 60, "infarct": 20, "hypertrophied": 20, "dilated": 20}
THETA, TRIES, CAUSES_ON = 5, 10, 2
LENGTHS_MM, PRESSURES_MMHG = (60.0, 100.0), (5.0, 15.0)
SEPTUM = (0, 0, -1)
LOOKED_UP = "looked_up"

OF_COHORT = {"plain": 20, "infarct": 10, "hypertrophied": 10, "dilated": 10}
PLANTED = {name: {"septal_load": 4.5} for name in ("plain_3", "infarct_4", "dilated_5")}
DAMAGED = {"plain_7": "cut off", "hypertrophied_2": "in kPa"}
EFFECTS = (
    {"septal_load": 4.0},
    {"basal_motion": 30.0},
    {"strain_measure": -1.0},
    {"endocardial_sampling": 0.8},
    {"segment_rotation": 12.0},
    {"mixed_frames": 0.4},
    {"helix_endo": 25.0},
    {"anisotropy": 3.0},
    {"compressibility": 0.03},
    {"focal_scar_8": 4.0},
    {"epicardial_support": 0.03},
    {"line_strain": 1.0},
)
"""Of the hearts in turn; the first half is what `regional-lv run` suspects by default."""

STRAIN_SD, VOLUME_SD_ML, READ_SD_MM = 0.02, 2.0, 0.5
MISREAD = {"segment_thickness": {"role": "measured", "sd_mm": 1.0}}
STIFFNESS = {"C_a": (0.3, 2.0), "C_b": (0.5, 2.0)}
"""Between which true factors of the cohort are drawn, at 8 mmHg and in a wall like the
volunteer's."""


def hearts(endocardia: list[str], folder: Path) -> Iterator[tuple[str, str, dict]]:
    """Name, group and geometry (keys of the configuration) of each heart."""
    base = shipped().known.base["geometry"]
    length = base["length_mm"]
    angles = population.SegmentAngles(base["table"], length)
    drawn = population.draw(base["table"], length, 4 * sum(WANTED.values()), SEED)
    rng = np.random.default_rng(SEED)
    for group, many in WANTED.items():
        for n, shape in enumerate(drawn.loc[drawn[population.HEART] == group].to_numpy()[:many]):
            scale = rng.uniform(*LENGTHS_MM) / length
            table = angles.table_of(shape[1:].astype(float))
            lengths = [column for column in table if column.endswith("_mm")]
            table[lengths] = table[lengths] * scale
            path = folder / f"{group}_{n}.csv"
            table.drop(columns="line", errors="ignore").to_csv(path, index=False)
            apex = -length * scale
            thickness = shape[1 + population.COLUMNS.index("apex")] * scale
            ends = {"endo_apex_z_mm": apex, "epi_apex_z_mm": apex - thickness}
            yield f"{group}_{n}", group, {"source": "segments", "segments": str(path), **ends}
    yield "volunteer", "volunteer", {}
    for endocardium in endocardia:
        name = Path(endocardium).stem.removesuffix("_endo")
        yield name, "surfaces", {"source": "surfaces", "surfaces": real_surfaces(endocardium)}


def real_surfaces(endocardium: str) -> dict:
    """Section `geometry.surfaces` of a real heart."""
    return {
        "endocardium": str(Path(endocardium).resolve()),
        "epicardium": str(Path(endocardium.replace("_endo", "_epi")).resolve()),
        "septum": list(SEPTUM),
        "unit": "mm",
    }


def configuration(name: str, geometry: dict, pressure: float) -> dict:
    """Of a study of this heart, with all causes suspected."""
    own = {
        "study": f"heart_{name}",
        "geometry": geometry,
        "loading": {"pressure_mmhg": pressure},
        "inputs": {"causes": "suspected"},
        "subjects": {},
    }
    return study_config.load(study_config.merged(study_config.read(ONE_HEART), own))


def softest(inputs: Inputs) -> float:
    """By how much the stress of this wall is larger than of the emulator's own heart (Laplace)."""
    ratio = []
    for model in (inputs.base, shipped().known.base):
        mid = model["geometry"]["table"].iloc[[s - 1 for s in LEVELS["mid"]]]
        thickness, radius = (mid[column].mean() for column in population.SHAPE)
        ratio.append(radius / thickness)
    return max(1.0, ratio[0] / ratio[1])


def draw(inputs: Inputs, others: Sequence[str], rng: np.random.Generator) -> np.ndarray:
    """Stiffness anywhere in its range, two causes on (of those that `others` has, too), all else as
    read."""
    x, wider = inputs.nominal.copy(), softest(inputs)
    suspected = [
        k
        for k, (name, role) in enumerate(zip(inputs.names, inputs.roles, strict=True))
        if role.kind == "suspected" and name in others
    ]
    on = rng.choice(suspected, CAUSES_ON, replace=False)
    for k, each in enumerate(inputs):
        if isinstance(each, Stiffness) or k in on:
            raised = wider if isinstance(each, Stiffness) and each.stress_power else 1.0
            ends = each.scale(min(each.low * raised, each.high)), each.scale(each.high)
            x[k] = each.scale.inverse(float(rng.uniform(*ends)))
    return x


def look_up(name: str, group: str, geometry: dict, seed: int, folder: Path) -> str:
    """Write what the emulator and the simulator say of a heart, a row for each output; simulate it
    if that has not been done."""
    rng, any_heart = np.random.default_rng([SEED, seed]), shipped()
    config = configuration(name, geometry, round(float(rng.uniform(*PRESSURES_MMHG)), 1))
    described = config["geometry"]["source"] != "segments"
    simulated, written = folder / f"{name}.parquet", folder / LOOKED_UP / f"{name}.parquet"
    with tempfile.TemporaryDirectory() as temporary:
        by_figures = by_table(config, Path(temporary) / "described.csv")
        try:
            cut, _ = within(by_figures, any_heart.emulator, any_heart.known)
        except OutOfReach as refusal:
            refused = {"heart": [name], "group": group, "refused": str(refusal)}
            pd.DataFrame(refused).to_parquet(written)
            return str(refusal)
        physics, channels = sections_of(cut), Channels.from_config(cut)
        inputs = Inputs.from_config(physics).simulated
        if not simulated.exists():
            mesh = make_heart(config, HeartFiles(f"{temporary}/"))
            own = Inputs.from_config(sections_of(config)).simulated
            simulate(Ventricles(mesh, own), inputs, rng).to_parquet(simulated, index=False)
        emulator = any_heart.of_heart(physics, channels, described).of_study_mesh
    table = pd.read_parquet(simulated)
    found = emulator.predict(torch.as_tensor(table[list(inputs.names)].to_numpy()))
    parts = [
        pd.DataFrame(
            {
                "heart": name,
                "group": group,
                "theta": table.index,
                "channel": channel.name,
                "quantity": channel.quantity,
                "simulated": table[channel.name],
                "mean": found.mean[:, d].numpy(),
                "sd": found.sd[:, d].numpy(),
            }
        )
        for d, channel in enumerate(channels)
    ]
    pd.concat(parts).to_parquet(written, index=False)
    return f"{len(table)} simulations"


def simulate(ventricle: Ventricles, inputs: Inputs, rng: np.random.Generator) -> pd.DataFrame:
    """Values of the emulated inputs and of the outputs, a row a simulation that converged."""
    own, rows = ventricle.inputs, []
    for _ in range(TRIES):
        values = dict(zip(inputs.names, draw(inputs, own.names, rng), strict=True))
        there = [values.get(*pair) for pair in zip(own.names, own.nominal, strict=True)]
        try:
            y = ventricle.outputs(np.array(there))
        except ArithmeticError:
            continue
        rows.append(values | dict(zip(ventricle.channels.names, y.tolist(), strict=True)))
        if len(rows) == THETA:
            break
    return pd.DataFrame(rows)


def summary(found: pd.DataFrame) -> pd.DataFrame:
    """Errors by quantity and group; of volumes, shares of them."""
    size = found["simulated"].where(found["quantity"] == "volume", 1.0)
    found = found.assign(
        error=((found["mean"] - found["simulated"]) / size).abs(),
        held=(found["mean"] - found["simulated"]).abs() <= Z95 * found["sd"],
    )
    found = pd.concat([found, found.assign(group="all")])
    groups = found.groupby(["quantity", "group"], sort=False)
    by_heart = found.groupby(["quantity", "group", "heart"], sort=False)["held"].mean()
    return pd.DataFrame(
        {
            "hearts": groups["heart"].nunique(),
            "median_error": groups["error"].median(),
            "rms_error": groups["error"].apply(lambda e: np.sqrt(np.square(e).mean())),
            "coverage95": groups["held"].mean(),
            "lowest_coverage_of_a_heart": by_heart.groupby(level=[0, 1], sort=False).min(),
        }
    ).reset_index()


def errors(folder: str, *endocardia: str) -> None:
    place = Path(folder)
    (place / LOOKED_UP).mkdir(parents=True, exist_ok=True)
    every = enumerate(hearts(list(endocardia), place))
    in_parallel(look_up, [(*heart, n, place) for n, heart in every])
    tables = [pd.read_parquet(path) for path in sorted((place / LOOKED_UP).glob("*.parquet"))]
    known = [table for table in tables if "simulated" in table]
    found = summary(pd.concat(known))
    found.to_csv(place / "errors.csv", index=False, float_format="%.3g")
    print(found.to_string(index=False), f"{len(tables) - len(known)} hearts out of reach", sep="\n")


def in_parallel(do: Callable, todo: Sequence[tuple]) -> None:
    """Do it with each, and say what became of it."""
    with ProcessPoolExecutor(int(os.environ.get("CORES", "2"))) as pool:
        jobs = {pool.submit(do, *each): each[0] for each in todo}
        for done, job in enumerate(as_completed(jobs), start=1):
            try:
                said = job.result()
            except Exception as error:  # of this heart; the others go on
                said = f"{type(error).__name__}: {error}"
            print(f"{done}/{len(jobs)} {jobs[job]}: {said}", flush=True)


def measure(
    name: str, geometry: dict, planted: dict, seed: int, folder: Path, misread: dict | None = None
) -> str:
    """Write the folder of a heart that was measured once, and the truth beside. planted: effects,
    by input. misread: section `inputs` of what is otherwise than the geometry says."""
    rng = np.random.default_rng([SEED, 1, seed])
    pressure = round(float(rng.uniform(*PRESSURES_MMHG)), 1)
    own = {
        "study": "other_heart",
        "geometry": geometry,
        "loading": {"pressure_mmhg": pressure},
        "inputs": dict.fromkeys(planted, "suspected") | (misread or {}),
        "subjects": {},
    }
    config = study_config.load(own)
    inputs = Inputs.from_config(sections_of(config))
    truth, x = {}, inputs.nominal.copy()
    folder.mkdir(parents=True, exist_ok=True)
    described = by_table(config, folder / "described.csv")
    scale = softest(Inputs.from_config(sections_of(described))) * pressure / 8
    for k, (each, role) in enumerate(zip(inputs, inputs.roles, strict=True)):
        if role.kind == "measured":
            x[k] = np.clip(x[k] + role.sd * rng.standard_normal(), each.low, each.high)
        elif isinstance(each, Stiffness):
            low, high = STIFFNESS[each.name[:3]]
            factor = scale if each.stress_power else 1.0
            value = factor * float(np.exp(rng.uniform(np.log(low), np.log(high))))
            truth[each.name] = x[k] = float(np.clip(value, 1.02 * each.low, 0.98 * each.high))
        elif each.name in planted:
            x[k] = planted[each.name]
    with tempfile.TemporaryDirectory() as temporary:
        ventricle = Ventricles(make_heart(config, HeartFiles(f"{temporary}/")), inputs)
        y = ventricle.outputs(x)
    channels = list(ventricle.channels)
    is_volume = np.array([channel.quantity == "volume" for channel in channels])
    sd = np.where(is_volume, VOLUME_SD_ML, STRAIN_SD)
    measured = pd.DataFrame(
        {
            "quantity": [channel.quantity for channel in channels],
            "segment": pd.array([channel.segment for channel in channels], dtype="Int64"),
            "value": y + sd * rng.standard_normal(len(y)),
            "unit": np.where(is_volume, "mL", "1"),
            "sd": sd,
        }
    )
    if DAMAGED.get(name) == "cut off":
        measured = measured.iloc[:20].assign(value="")
    if DAMAGED.get(name) == "in kPa":
        pressure = round(pressure / 7.50062, 2)
    measured.to_csv(folder / "measured.csv", index=False)
    if geometry["source"] == "segments":
        table = pd.read_csv(geometry["segments"])
        for column in population.SHAPE:
            table[column] += READ_SD_MM * rng.standard_normal(len(table))
            table[column.replace("_mm", "_sd_mm")] = READ_SD_MM
        table.to_csv(folder / "segments.csv", index=False)
        geometry = geometry | {"segments": "segments.csv"}
    given = {
        "study": f"heart_{name}",
        "geometry": geometry,
        "loading": {"pressure_mmhg": pressure},
        "subjects": {"patient": {"source": "file", "measured": "measured.csv"}},
    }
    # JSON is YAML.
    (folder / "config.yaml").write_text(json.dumps(given, indent=1) + "\n")
    (folder / "truth.json").write_text(json.dumps({"heart": name, **planted, **truth}))
    return "measured"


def cohort(folder: str, *endocardia: str) -> None:
    place = Path(folder)
    shapes, counts, kept = place / "shapes", dict.fromkeys(OF_COHORT, 0), []
    shapes.mkdir(parents=True, exist_ok=True)
    for n, (name, group, geometry) in enumerate(hearts(list(endocardia), shapes)):
        counts[group] = counts.get(group, 0) + 1
        if group != "volunteer" and counts[group] <= OF_COHORT.get(group, len(endocardia)):
            kept.append((name, geometry, PLANTED.get(name, {}), n))
    write_cohort(place, kept)


def of_surfaces(place: Path, endocardia: Sequence[str]) -> Iterator[tuple[int, str, dict]]:
    """Number, name and geometry of the hearts from surfaces alone."""
    place.mkdir(parents=True, exist_ok=True)
    real = (each for each in hearts(list(endocardia), place) if each[1] == "surfaces")
    for n, (name, _, geometry) in enumerate(real):
        yield n, name, geometry


def planted(folder: str, *endocardia: str) -> None:
    real = of_surfaces(Path(folder), endocardia)
    kept = [(name, its, EFFECTS[n % len(EFFECTS)], 1000 + n) for n, name, its in real]
    write_cohort(Path(folder), kept)


def misread(folder: str, *endocardia: str) -> None:
    kept = [(name, its, {}, 2000 + n) for n, name, its in of_surfaces(Path(folder), endocardia)]
    write_cohort(Path(folder), kept, MISREAD)


def write_cohort(place: Path, kept: Sequence[tuple], misread: dict | None = None) -> None:
    """Measure these hearts (arguments of `measure`), and write the cohort's own files."""
    todo = [(*each, place / "hearts" / each[0]) for each in kept]
    waiting = [each for each in todo if not (each[-1] / "truth.json").exists()]
    in_parallel(partial(measure, misread=misread), waiting)
    truths = [json.loads(path.read_text()) for path in sorted(place.glob("hearts/*/truth.json"))]
    pd.DataFrame(truths).to_csv(place / "truth.csv", index=False)
    (place / "config.yaml").write_text(f"study: {place.name}\ncohort: hearts/*/\n")


def score(folder: str, answers: str) -> None:
    truth = pd.read_csv(Path(folder) / "truth.csv", dtype={"heart": str}).set_index("heart")
    found = pd.read_parquet(answers).set_index("heart")
    for name, why in found.loc[found["reason"] != "", "reason"].items():
        print(f"{name}: {why}")
    found = found[found["reason"] == ""]
    truth = truth.loc[found.index]
    names = [name for name in truth if name[:3] in STIFFNESS]
    lines = []
    for suffix in ("", "_as_is", "_pooled"):
        low, high = (
            found[[f"{n}{suffix}_{end}95" for n in names]].to_numpy(float)
            for end in ("lower", "upper")
        )
        held = (low <= truth[names].to_numpy()) & (truth[names].to_numpy() <= high)
        group = [name.split("_")[0] if "_" in name else "surfaces" for name in found.index]
        table = pd.DataFrame(
            {"group": group, "held": held.mean(1), "ratio": np.median(high / low, 1)}
        )
        every = pd.concat([table, table.assign(group="all")])
        mean = every.groupby("group").agg(
            hearts=("held", "size"), held=("held", "mean"), width=("ratio", "median")
        )
        lines.append(mean.assign(intervals=suffix or "_averaged"))
    print(pd.concat(lines).round(3).to_string())
    effects = truth.drop(columns=names)
    of_effect = {
        heart: f"{name} {value:g}: {found.get(f'{name}_probability', {}).get(heart, np.nan):.2f}"
        for (heart, name), value in effects.stack().items()
    }
    columns = ["trusted", "misfit_p_value", "causes", "verdict"]
    print(found[columns].assign(effect=pd.Series(of_effect, dtype=str)).to_string())


COMMANDS = {
    "errors": errors,
    "cohort": cohort,
    "planted": planted,
    "misread": misread,
    "score": score,
}

if __name__ == "__main__":
    COMMANDS[sys.argv[1]](*sys.argv[2:])
