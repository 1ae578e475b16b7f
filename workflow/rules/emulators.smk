"""Training, and the error on the simulations of the test set and of those held out beside it."""


rule train_emulator:
    input:
        train=LAYOUT.screened("train"),
    output:
        emulator_file=LAYOUT.emulator("{emulator}"),
        report=LAYOUT.fit("{emulator}"),
    log:
        f"{LOGS}/emulators/{{emulator}}/train.log",
    benchmark:
        f"{R}/benchmarks/emulators/{{emulator}}.tsv"
    wildcard_constraints:
        emulator=any_of(EMULATORS),
    priority: FIRST
    threads: 1
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        call="emulators.training:train_emulator",
        name=lambda wildcards: EMULATORS[wildcards.emulator][0],
        settings=lambda wildcards: EMULATORS[wildcards.emulator][1],
    script:
        "../scripts/call.py"


ESTIMATES = f"{R}/estimates"
# What an emulator is asked on a set of known theta, and what comes of it.
ASKED = {"predicted": "emulators.training:predict_test_set"}
ANSWERS = {
    "predictions": LAYOUT.predictions("{emulator}", "{set}"),
    "errors": f"{R}/emulators/{{emulator}}/{{set}}_errors.csv",
}
if EVALUATION:
    ASKED["estimated"] = "paper.estimates.estimate:estimate_parameters"
    ANSWERS["estimates"] = LAYOUT.estimates("{emulator}", "{set}")


rule judge_emulator:
    """Outputs from theta and, where emulators are compared, theta from outputs."""
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        test=LAYOUT.screened("{set}"),
    output:
        **ANSWERS,
    log:
        f"{LOGS}/emulators/{{emulator}}/judge_{{set}}.log",
    benchmark:
        f"{R}/benchmarks/estimates/{{emulator}}_{{set}}.tsv"
    wildcard_constraints:
        set=any_of(SCORED),
    threads: 1
    resources:
        **needs(mem_mb=4000, minutes=120),
    params:
        calls=ASKED,
    script:
        "../scripts/call.py"
