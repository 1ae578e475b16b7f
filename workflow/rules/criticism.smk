"""What the simulation gets wrong, why, and what correcting it gains."""

C = f"{R}/criticism"
HYPOTHESES = asked(config["criticism"]["hypotheses"], PHYSICS)
JOINT = config["criticism"]["joint"]
CRITICISM = {
    key: config["criticism"][key]
    for key in ("bootstrap", "level", "draws", "largest_set", "confirmation")
}
CRITICISM["load_fractions"] = (
    [] if why_not_scaling(PHYSICS) else config["criticism"]["load_fractions"]
)
CRITICISED = [
    *SUBJECTS,
    *(name for name, entry in JOINT.items() if set(entry["subjects"]) <= set(SUBJECTS)),
]
HEARTS = sum(config["criticism"]["benchmark"]["hearts"].values())
BENCHMARK_BATCHES = batches(HEARTS, config["criticism"]["benchmark"]["subjects_per_batch"])
INJECTED_MESH = f"{R}/geometry/{'finer/' if meshes_anew(config) else ''}mesh.vtu"
# Jobs that share the simulations of one round: all that follows waits for them.
CONFIRMED_IN = 2
# The last one simulates again what was simulated elsewhere (`Settings.turns`).
TURNS = range(CRITICISM["confirmation"]["rounds"] + 1)
STEP = {
    "settings": CRITICISM,
    "strain_exponent": config["observables"]["strain_exponent"],
    "noise_prior_scale": config["clinical"]["noise_prior_scale"],
    "seed": config["seed"],
}
BENCHMARK_STEP = STEP | {
    "settings": CRITICISM | {"bootstrap": config["criticism"]["benchmark"]["bootstrap"]},
    "batch_size": config["criticism"]["benchmark"]["subjects_per_batch"],
}
EXTENSIONS = expand(f"{C}/extensions/{{hypothesis}}.pt", hypothesis=HYPOTHESES)
DISCRETISATION = f"{C}/discretisation.pt" if config["criticism"]["discretisation"] else []
EMULATORS_OF = {
    "emulator": f"{R}/emulators/{EMULATOR}.pt",
    "extensions": EXTENSIONS,
    "discretisation": DISCRETISATION,
}
OF_SUBJECT = EMULATORS_OF | {
    "measured": lambda wildcards: expand(
        f"{R}/measured/{{subject}}.csv", subject=criticised(wildcards.subject)
    ),
    "known_theta": lambda wildcards: known_theta(wildcards.subject),
}
OF_BATCH = EMULATORS_OF | {"subjects": f"{C}/benchmark/subjects.parquet"}


rule extensions:
    """What every hypothesis changes, for all subjects of the study."""
    input:
        EXTENSIONS,


rule simulate_extension:
    """From the anchors' fields; the anchors of one batch at all values of one effect."""
    input:
        unpack(anchors_of),
    output:
        simulations=f"{C}/simulations/{{hypothesis}}/batch-{{batch}}.parquet",
    log:
        f"{LOGS}/criticism/simulations/{{hypothesis}}-batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/simulations/{{hypothesis}}-batch-{{batch}}.tsv"
    wildcard_constraints:
        hypothesis=any_of(HYPOTHESES),
    priority: FIRST
    threads: 1
    params:
        call="criticism.simulation:simulate_extension",
        code=lambda wildcards: code_of_hypothesis(wildcards.hypothesis),
        physics=PHYSICS,
        most=lambda wildcards: anchors_per_batch(HYPOTHESES[wildcards.hypothesis]),
    script:
        "../scripts/call.py"


rule train_extension:
    """Closed forms need no simulations; their file says what they are."""
    input:
        batches=lambda wildcards: extension_batches(HYPOTHESES[wildcards.hypothesis]),
    output:
        extension=f"{C}/extensions/{{hypothesis}}.pt",
        report=f"{C}/extensions/{{hypothesis}}.json",
    log:
        f"{LOGS}/criticism/extensions/{{hypothesis}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/extensions/{{hypothesis}}.tsv"
    wildcard_constraints:
        hypothesis=any_of(HYPOTHESES),
    priority: FIRST
    threads: 1
    params:
        call="criticism.extension:train_extension",
        physics=PHYSICS,
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        seed=config["seed"],
    script:
        "../scripts/call.py"


rule train_discretisation:
    """What the finer mesh changes of the base model."""
    input:
        train=f"{R}/screening/train.parquet",
        batches=expand(f"{R}/mechanics/finer/anchors/{{batch}}.parquet", batch=ANCHOR_BATCHES),
    output:
        discretisation=f"{C}/discretisation.pt",
        report=f"{C}/discretisation.json",
    log:
        f"{LOGS}/criticism/discretisation.log",
    benchmark:
        f"{R}/benchmarks/criticism/discretisation.tsv"
    priority: FIRST
    threads: 1
    params:
        call="criticism.discretisation:train_discretisation",
        physics=PHYSICS,
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        seed=config["seed"],
    script:
        "../scripts/call.py"


rule inject_batch:
    """Ventricles with hidden effects; writes their truth and reads none."""
    input:
        mesh=INJECTED_MESH,
    output:
        subjects=temp(f"{C}/benchmark/subjects/batch-{{batch}}.parquet"),
        truth=temp(f"{R}/truth/benchmark/batch-{{batch}}.parquet"),
    log:
        f"{LOGS}/criticism/benchmark/inject-batch-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/benchmark/inject-batch-{{batch}}.tsv"
    threads: 1
    params:
        call="criticism.injection:inject_batch",
        physics=PHYSICS,
        parameters=PARAMETER_SPEC,
        hypotheses=config["criticism"]["hypotheses"],
        benchmark=config["criticism"]["benchmark"],
        seed=config["seed"],
        batch_size=config["criticism"]["benchmark"]["subjects_per_batch"],
    script:
        "../scripts/call.py"


rule gather_injected:
    input:
        batches=expand(f"{C}/benchmark/subjects/{{batch}}.parquet", batch=BENCHMARK_BATCHES),
    output:
        table=f"{C}/benchmark/subjects.parquet",
    log:
        f"{LOGS}/criticism/benchmark/gather_injected.log",
    localrule: True
    params:
        call="criticism.batches:gather",
    script:
        "../scripts/call.py"


rule gather_truth:
    """For the score of the benchmark alone."""
    input:
        batches=expand(f"{R}/truth/benchmark/{{batch}}.parquet", batch=BENCHMARK_BATCHES),
    output:
        table=f"{R}/truth/benchmark.parquet",
    log:
        f"{LOGS}/criticism/benchmark/gather_truth.log",
    localrule: True
    params:
        call="criticism.batches:gather",
    script:
        "../scripts/call.py"


rule criticism:
    """The page of every subject."""
    input:
        expand(f"{C}/{{subject}}/report.html", subject=CRITICISED),
        expand(
            f"{C}/{{subject}}/compared.csv",
            subject=(list(JOINT) or SUBJECTS) if config["criticism"]["extends"] else [],
        ),


rule search_causes:
    """Of one subject, or of several together. Reads what was measured, never a truth."""
    input:
        **OF_SUBJECT,
    output:
        search=f"{C}/{{subject}}/search.json",
    log:
        f"{LOGS}/criticism/{{subject}}/search.log",
    benchmark:
        f"{R}/benchmarks/criticism/{{subject}}/search.tsv"
    wildcard_constraints:
        subject=any_of(CRITICISED),
    priority: FIRST
    threads: 1
    params:
        **STEP,
        call="criticism.study:search_causes",
        subjects=lambda wildcards: criticised(wildcards.subject),
    script:
        "../scripts/call.py"


rule plan_confirmation:
    """What has to be simulated of the leading sets of causes, round by round."""
    input:
        **OF_SUBJECT,
        search=f"{C}/{{subject}}/search.json",
        simulations=lambda wildcards: confirmations(wildcards.subject, int(wildcards.turn)),
    output:
        design=f"{C}/{{subject}}/confirmation/design-{{turn}}.parquet",
    log:
        f"{LOGS}/criticism/{{subject}}/plan-{{turn}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/{{subject}}/plan-{{turn}}.tsv"
    wildcard_constraints:
        subject=any_of(CRITICISED),
    priority: FIRST
    threads: 1
    params:
        **STEP,
        call="criticism.study:plan_confirmation",
        subjects=lambda wildcards: criticised(wildcards.subject),
    script:
        "../scripts/call.py"


rule simulate_sets:
    """The leading sets with all their effects at once, by the full simulator; of a subject, or of
    all hearts of a batch of the benchmark."""
    input:
        mesh=f"{R}/geometry/{CONFIRMED_ON}mesh.vtu",
        predictor=f"{R}/mechanics/{CONFIRMED_ON}predictor.npz",
        design=f"{C}/{{subject}}/confirmation/design-{{turn}}.parquet",
    output:
        simulations=f"{C}/{{subject}}/confirmation/simulations-{{turn}}-{{part}}.parquet",
    log:
        f"{LOGS}/criticism/{{subject}}/simulate-{{turn}}-{{part}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/{{subject}}/simulate-{{turn}}-{{part}}.tsv"
    wildcard_constraints:
        subject="|".join([*CRITICISED, r"benchmark/batch-\d+"]),
    priority: FIRST
    threads: 1
    params:
        call="criticism.injection:simulate_sets",
        parts=CONFIRMED_IN,
        physics=PHYSICS,
        parameters=PARAMETER_SPEC,
    script:
        "../scripts/call.py"


rule conclude_criticism:
    """The verdict, with what the simulations say."""
    input:
        **OF_SUBJECT,
        search=f"{C}/{{subject}}/search.json",
        simulations=lambda wildcards: confirmations(wildcards.subject, len(TURNS)),
    output:
        findings=f"{C}/{{subject}}/findings.json",
    log:
        f"{LOGS}/criticism/{{subject}}/conclude.log",
    benchmark:
        f"{R}/benchmarks/criticism/{{subject}}/conclude.tsv"
    wildcard_constraints:
        subject=any_of(CRITICISED),
    priority: FIRST
    threads: 1
    params:
        **STEP,
        call="criticism.study:conclude_criticism",
        subjects=lambda wildcards: criticised(wildcards.subject),
    script:
        "../scripts/call.py"


rule extend_study:
    """The study with the named causes switched on, as a configuration of its own."""
    input:
        findings=f"{C}/{{subject}}/findings.json",
        measured=OF_SUBJECT["measured"],
        known_theta=OF_SUBJECT["known_theta"],
    output:
        extended=f"{C}/{{subject}}/extended.yaml",
        corrected=directory(f"{C}/{{subject}}/extended"),
    log:
        f"{LOGS}/criticism/{{subject}}/extend.log",
    wildcard_constraints:
        subject=any_of(CRITICISED),
    localrule: True
    params:
        call="criticism.extend:write_extended",
        config=config,
        subjects=lambda wildcards: criticised(wildcards.subject),
    script:
        "../scripts/call.py"


rule compare_extended:
    """A subject before and after its causes became part of the model."""
    input:
        before=config["criticism"]["extends"] or [],
        after=f"{C}/{{subject}}/findings.json",
    output:
        table=f"{C}/{{subject}}/compared.csv",
    log:
        f"{LOGS}/criticism/{{subject}}/compare.log",
    wildcard_constraints:
        subject=any_of(CRITICISED),
    localrule: True
    params:
        call="criticism.extend:compare_extended",
        subject=lambda wildcards: wildcards.subject,
    script:
        "../scripts/call.py"


rule report_criticism:
    input:
        findings=f"{C}/{{subject}}/findings.json",
    output:
        page=report(
            f"{C}/{{subject}}/report.html",
            caption="../report/criticism.rst",
            category="Criticism",
        ),
        residuals=f"{C}/{{subject}}/residuals.png",
        table=f"{C}/{{subject}}/residuals.csv",
    log:
        f"{LOGS}/criticism/report_{{subject}}.log",
    wildcard_constraints:
        subject=any_of(CRITICISED),
    localrule: True
    params:
        call="criticism.report:write_report",
    script:
        "../scripts/call.py"


rule hidden_effects:
    """The benchmark: what is found of effects injected at random."""
    input:
        f"{C}/benchmark/summary.json",
        f"{C}/benchmark/hidden_effects.png",


rule search_benchmark:
    """Blind: reads the measured hearts alone."""
    input:
        **OF_BATCH,
    output:
        searches=f"{C}/benchmark/searches/batch-{{batch}}.json",
    log:
        f"{LOGS}/criticism/benchmark/search-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/benchmark/search-{{batch}}.tsv"
    threads: 1
    params:
        **BENCHMARK_STEP,
        call="criticism.benchmark:search_batch",
    script:
        "../scripts/call.py"


rule plan_benchmark:
    """What has to be simulated to confirm what was found of a batch."""
    input:
        **OF_BATCH,
        searches=f"{C}/benchmark/searches/batch-{{batch}}.json",
        simulations=lambda wildcards: confirmations(
            f"benchmark/batch-{wildcards.batch}", int(wildcards.turn)
        ),
    output:
        design=f"{C}/benchmark/batch-{{batch}}/confirmation/design-{{turn}}.parquet",
    log:
        f"{LOGS}/criticism/benchmark/plan-{{batch}}-{{turn}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/benchmark/plan-{{batch}}-{{turn}}.tsv"
    threads: 1
    params:
        **BENCHMARK_STEP,
        call="criticism.benchmark:plan_batch",
    script:
        "../scripts/call.py"


rule conclude_benchmark:
    """The verdicts of a batch."""
    input:
        **OF_BATCH,
        searches=f"{C}/benchmark/searches/batch-{{batch}}.json",
        simulations=lambda wildcards: confirmations(
            f"benchmark/batch-{wildcards.batch}", len(TURNS)
        ),
    output:
        verdicts=f"{C}/benchmark/verdicts/batch-{{batch}}.parquet",
    log:
        f"{LOGS}/criticism/benchmark/conclude-{{batch}}.log",
    benchmark:
        f"{R}/benchmarks/criticism/benchmark/conclude-{{batch}}.tsv"
    threads: 1
    params:
        **BENCHMARK_STEP,
        call="criticism.benchmark:conclude_batch",
    script:
        "../scripts/call.py"


rule score_benchmark:
    """The one rule of the criticism that reads a truth, after all verdicts are in."""
    input:
        emulator=f"{R}/emulators/{EMULATOR}.pt",
        discretisation=DISCRETISATION,
        subjects=f"{C}/benchmark/subjects.parquet",
        verdicts=expand(f"{C}/benchmark/verdicts/{{batch}}.parquet", batch=BENCHMARK_BATCHES),
        truth=f"{R}/truth/benchmark.parquet",
    output:
        cases=f"{C}/benchmark/cases.csv",
        confusion=f"{C}/benchmark/confusion.csv",
        summary=f"{C}/benchmark/summary.json",
    log:
        f"{LOGS}/criticism/benchmark/score_benchmark.log",
    localrule: True
    params:
        call="criticism.benchmark:score_benchmark",
    script:
        "../scripts/call.py"


rule plot_hidden_effects:
    input:
        cases_file=f"{C}/benchmark/cases.csv",
    output:
        png=report(
            f"{C}/benchmark/hidden_effects.png",
            caption="../report/hidden_effects.rst",
            category="Criticism",
        ),
        csv=f"{C}/benchmark/hidden_effects.csv",
    log:
        f"{LOGS}/criticism/benchmark/plot_hidden_effects.log",
    localrule: True
    params:
        call="plots.hidden_effects:draw",
    script:
        "../scripts/call.py"
