"""Where the files of a study lie: each kind of file has one name, for the library, the command line
and the workflow.

Paths are text, as Snakemake takes them. A part of a name (a subject, a set, an emulator) may be a
wildcard, such as `{subject}`. Of files with two forms, `ending` is that of the one that is meant.
"""

from pathlib import Path

RESULTS = "results"
"""Holds the folders of all studies; in the working folder."""


def study_of(path: str | Path) -> str:
    """The study that a path below `results/<study>/` belongs to."""
    return Path(path).parts[1]


class HeartFiles:
    """A meshed heart. folder: with its slash at the end."""

    def __init__(self, folder: str):
        self.mesh = f"{folder}mesh.vtu"
        self.gmsh = f"{folder}mesh.msh"
        self.segments = f"{folder}segments.csv"
        self.summary = f"{folder}summary.json"
        # Of meshes that are imported: as it was read, and how close the new mesh is.
        self.imported = f"{folder}imported.vtu"
        self.fit = f"{folder}fit.csv"


class AnswerFiles:
    """A heart that was answered without simulations of its own for that."""

    def __init__(self, folder: str):
        self.folder = folder
        # The table that stands for surfaces or a mesh.
        self.segments = f"{folder}/segments.csv"
        self.measured = f"{folder}/measured.csv"
        self.findings = f"{folder}/findings.json"
        self.posterior = f"{folder}/posterior.nc"
        self.page = f"{folder}/page.html"

    def figure(self, name: str, ending: str) -> str:
        """png, and csv of its data."""
        return f"{self.folder}/{name}.{ending}"


class BatchFiles:
    """Hearts of a cohort that one job answered."""

    def __init__(self, folder: str):
        self.folder = folder
        self.failed = f"{folder}/failed.json"

    def heart(self, name: str) -> AnswerFiles:
        return AnswerFiles(f"{self.folder}/{name}")


class CohortFiles:
    """Many hearts in one study."""

    def __init__(self, folder: str):
        self.folder = folder
        self.checked = f"{folder}/checked.json"
        self.hearts = f"{folder}/hearts.parquet"
        self.population = f"{folder}/population.csv"
        self.causes = f"{folder}/causes.csv"
        self.page = f"{folder}/page.html"

    def batch(self, batch: str) -> BatchFiles:
        return BatchFiles(f"{self.folder}/hearts/{batch}")


class PosteriorFiles:
    """Posteriors of the stiffness by one emulator, of the model as it is."""

    def __init__(self, folder: str):
        self.folder = folder

    def batch(self, set: str, batch: str) -> str:
        """Draws of cases of a set."""
        return f"{self.folder}/{set}/batch-{batch}.nc"

    def of_set(self, set: str, table: str) -> str:
        return f"{self.folder}/{set}/{table}.csv"

    def of_subject(self, subject: str, ending: str) -> str:
        """nc: draws; csv: their diagnostics."""
        return f"{self.folder}/subjects/{subject}.{ending}"

    def checked(self, table: str) -> str:
        """A check of the inference over all cases."""
        return f"{self.folder}/{table}.csv"


class Layout:
    """A study. folder: `results/<study>`, unless a session has another one.

    mesh_folder: of which mesh something is: the study's own (""), or another one of the same
    ventricle, such as `finer/`.
    """

    def __init__(self, folder: str):
        self.folder = folder
        self.manifest = f"{folder}/manifest.json"
        # The configuration that the command line has answered, one line.
        self.claimed_by = f"{folder}/configuration.txt"
        self.cohort = CohortFiles(f"{folder}/cohort")
        # What a heart's configuration is cut to where it is partly beyond the emulator of any.
        self.cut = f"{folder}/cut.yaml"
        self.explained_variance = f"{folder}/reduction/explained_variance.csv"
        # Read while the workflow is planned.
        self.shortlist = f"{folder}/estimates/shortlist.json"

    @classmethod
    def of(cls, study: str) -> "Layout":
        return cls(f"{RESULTS}/{study}")

    def published(self, file: str) -> str:
        """The study's copy of a published file."""
        return f"{self.folder}/published/{file}"

    # ---------------------------------------------------------------- geometry and simulations

    def heart(self, mesh_folder: str = "") -> HeartFiles:
        return HeartFiles(f"{self.folder}/geometry/{mesh_folder}")

    def baseline(self, ending: str, mesh_folder: str = "") -> str:
        """npz: the state; json: what it took."""
        return f"{self.folder}/mechanics/{mesh_folder}baseline.{ending}"

    def anchors(self, batch: str, ending: str, mesh_folder: str = "") -> str:
        """npz: the states; parquet: as simulations."""
        return f"{self.folder}/mechanics/{mesh_folder}anchors/batch-{batch}.{ending}"

    def predictor(self, mesh_folder: str = "") -> str:
        return f"{self.folder}/mechanics/{mesh_folder}predictor.npz"

    def strain_field(self, ending: str) -> str:
        """vtu: in the wall; parquet: as a table."""
        return f"{self.folder}/mechanics/strains.{ending}"

    def design(self, set: str) -> str:
        return f"{self.folder}/design/{set}.parquet"

    def simulations(self, set: str, batch: str) -> str:
        return f"{self.folder}/simulations/{set}/batch-{batch}.parquet"

    def screened(self, set: str) -> str:
        """Simulations that converged."""
        return f"{self.folder}/screening/{set}.parquet"

    def excluded(self, set: str) -> str:
        return f"{self.folder}/screening/{set}_excluded.csv"

    def screening_summary(self, set: str) -> str:
        return f"{self.folder}/screening/{set}_summary.csv"

    def inputs_predictor(self, mesh_folder: str = "") -> str:
        """Over all inputs, as the next."""
        return f"{self.folder}/all_inputs/{mesh_folder}predictor.npz"

    def inputs_screened(self, set: str) -> str:
        return f"{self.folder}/all_inputs/{set}.parquet"

    # ------------------------------------------------ emulators of the stiffness, point estimates

    def emulator(self, name: str) -> str:
        return f"{self.folder}/emulators/{name}.pt"

    def fit(self, emulator: str) -> str:
        return f"{self.folder}/emulators/{emulator}/fit.json"

    def predictions(self, emulator: str, set: str) -> str:
        return f"{self.folder}/emulators/{emulator}/{set}_predictions.parquet"

    def efficiency(self, emulator: str, transform: str) -> str:
        return f"{self.folder}/efficiency/{emulator}-{transform}.csv"

    def estimates(self, emulator: str, set: str) -> str:
        return f"{self.folder}/estimates/{emulator}/{set}.parquet"

    def estimates_checked(self, emulator: str, set: str) -> str:
        """The estimates passed back through the simulator."""
        return f"{self.folder}/estimates/{emulator}/{set}_checked.parquet"

    def estimates_cost(self, emulator: str) -> str:
        return f"{self.folder}/estimates/{emulator}/cost.json"

    def compared(self, table: str) -> str:
        """A comparison of emulators by their estimates."""
        return f"{self.folder}/estimates/{table}.csv"

    # ------------------------------------------------------------------ subjects and posteriors

    def measured(self, subject: str) -> str:
        return f"{self.folder}/measured/{subject}.csv"

    def truth(self, subject: str) -> str:
        return f"{self.folder}/truth/{subject}.json"

    def known_theta(self, subject: str) -> str:
        return f"{self.folder}/known_theta/{subject}.csv"

    def posteriors(self, emulator: str) -> PosteriorFiles:
        return PosteriorFiles(f"{self.folder}/posteriors/{emulator}")

    def findings(self, subject: str) -> str:
        return f"{self.folder}/criticism/{subject}/findings.json"

    def posterior(self, subject: str) -> str:
        """Averaged over models."""
        return f"{self.folder}/criticism/{subject}/posterior.nc"

    def extended(self, subject: str) -> str:
        """The configuration with the named causes."""
        return f"{self.folder}/criticism/{subject}/extended.yaml"

    def figure(self, name: str, ending: str) -> str:
        """png, and csv of its data."""
        return f"{self.folder}/figures/{name}.{ending}"

    def criticism_figure(self, subject: str, name: str, ending: str) -> str:
        return f"{self.folder}/criticism/{subject}/{name}.{ending}"

    def table(self, name: str, ending: str) -> str:
        return f"{self.folder}/tables/{name}.{ending}"

    def page(self, subject: str) -> str:
        return f"{self.folder}/pages/{subject}.html"

    def fast(self, subject: str) -> AnswerFiles:
        return AnswerFiles(f"{self.folder}/fast/{subject}")
