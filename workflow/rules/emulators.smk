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
    params:
        call="emulators.training:train_emulator",
        name=lambda wildcards: EMULATORS[wildcards.emulator][0],
        settings=lambda wildcards: EMULATORS[wildcards.emulator][1],
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        seed=config["seed"],
    script:
        "../scripts/call.py"


rule predict_test_set:
    input:
        emulator_file=LAYOUT.emulator("{emulator}"),
        test=LAYOUT.screened("{set}"),
    output:
        predictions=LAYOUT.predictions("{emulator}", "{set}"),
        errors=f"{R}/emulators/{{emulator}}/{{set}}_errors.csv",
    log:
        f"{LOGS}/emulators/{{emulator}}/predict_{{set}}.log",
    wildcard_constraints:
        set=any_of(SCORED),
    threads: 1
    params:
        call="emulators.training:predict_test_set",
    script:
        "../scripts/call.py"
