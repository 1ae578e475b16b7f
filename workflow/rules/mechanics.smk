"""Where every simulation starts: an inflation, anchors, and the fields predicted from them."""

# Two at least: nothing else can be simulated before the anchors.
ANCHOR_BATCHES = batches(ANCHORS, min(config["simulations"]["batch_size"], -(-ANCHORS // 2)))


rule solve_baseline:
    """Also compiles the forms once, before many processes ask for them at the same time."""
    input:
        mesh=LAYOUT.heart("{mesh_folder}").mesh,
    output:
        start=LAYOUT.baseline("npz", "{mesh_folder}"),
        summary=LAYOUT.baseline("json", "{mesh_folder}"),
    log:
        f"{LOGS}/mechanics/{{mesh_folder}}solve_baseline.log",
    benchmark:
        f"{R}/benchmarks/{{mesh_folder}}solve_baseline.tsv"
    priority: FIRST
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        call="simulation.batches:solve_baseline",
    script:
        "../scripts/call.py"


rule solve_anchors:
    """Each batch takes every n-th anchor, so that all batches span the box."""
    input:
        mesh=LAYOUT.heart("{mesh_folder}").mesh,
        start=LAYOUT.baseline("npz", "{mesh_folder}"),
        design=LAYOUT.design("train"),
    output:
        fields=LAYOUT.anchors("{batch}", "npz", "{mesh_folder}"),
        simulations=LAYOUT.anchors("{batch}", "parquet", "{mesh_folder}"),
    log:
        f"{LOGS}/mechanics/{{mesh_folder}}solve_anchors-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/{{mesh_folder}}anchors/batch-{{batch}}.tsv"
    priority: FIRST
    threads: 1
    resources:
        **needs(minutes=60),
    params:
        call="simulation.batches:solve_anchors",
        anchors=ANCHORS,
        batches=len(ANCHOR_BATCHES),
    script:
        "../scripts/call.py"


rule fit_predictor:
    input:
        anchors=expand(LAYOUT.anchors("{batch}", "npz", "{{mesh_folder}}"), batch=ANCHOR_BATCHES),
    output:
        predictor=LAYOUT.predictor("{mesh_folder}"),
    log:
        f"{LOGS}/mechanics/{{mesh_folder}}fit_predictor.log",
    benchmark:
        f"{R}/benchmarks/{{mesh_folder}}fit_predictor.tsv"
    priority: FIRST
    params:
        call="mechanics.predictor:fit_predictor",
    script:
        "../scripts/call.py"


rule calibrate_reference:
    """Not part of `all`: its result is written by hand into the law's `factors`."""
    input:
        mesh=LAYOUT.heart().mesh,
        predictor=LAYOUT.predictor(),
    output:
        calibration=f"{R}/mechanics/calibration.json",
    log:
        f"{LOGS}/mechanics/calibrate_reference.log",
    params:
        call="paper.reference_material:calibrate_reference",
    script:
        "../scripts/call.py"
