"""Published files of the paper's heart, and the check of an imported mesh against its re-meshing."""

rule fetch_published:
    """Where the file was found is no parameter: its content cannot differ (checksum)."""
    input:
        library=library("resources"),
    output:
        fetched_path(config["study"], "{file}"),
    wildcard_constraints:
        file="|".join(name for name in FILES if name != VOLUNTEER),
    log:
        f"{LOGS}/published/fetch-{{file}}.log",
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/fetch_published.py"


if config["geometry"]["source"] == "mesh" and IMPORTED["remesh"]:

    rule verify_imported_mesh:
        """Not part of `all`: the linear hexahedra of the published heart take half an hour."""
        input:
            imported=f"{R}/geometry/imported.vtu",
            remeshed=f"{R}/geometry/mesh.vtu",
            inputs=fetched_path(config["study"], TRAINING_INPUTS),
            outputs=fetched_path(config["study"], TRAINING_OUTPUTS),
            library=library("verification.imported_mesh"),
        output:
            f"{R}/verification/imported_mesh.csv",
        params:
            physics=PHYSICS,
        log:
            f"{LOGS}/verification/verify_imported_mesh.log",
        benchmark:
            f"{R}/benchmarks/verify_imported_mesh.tsv"
        conda:
            "../../envs/mechanics.yaml"
        script:
            "../scripts/verify_imported_mesh.py"
