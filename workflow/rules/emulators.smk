"""Training, and the error on the simulations of the test set and of those held out beside it."""


rule train_emulator:
    input:
        train=f"{R}/screening/train.parquet",
    output:
        emulator_file=f"{R}/emulators/{{emulator}}.pt",
        report=f"{R}/emulators/{{emulator}}/fit.json",
    priority: FIRST
    params:
        call="emulators:train_emulator",
        name=lambda wildcards: EMULATORS[wildcards.emulator][0],
        settings=lambda wildcards: EMULATORS[wildcards.emulator][1],
        parameters=PARAMETER_SPEC,
        channels=OUTPUTS,
        seed=config["seed"],
    wildcard_constraints:
        emulator=any_of(EMULATORS),
    log:
        f"{LOGS}/emulators/{{emulator}}/train.log",
    benchmark:
        f"{R}/benchmarks/emulators/{{emulator}}.tsv"
    threads: 1
    script:
        "../scripts/call.py"


rule predict_test_set:
    input:
        emulator_file=f"{R}/emulators/{{emulator}}.pt",
        test=f"{R}/screening/{{set}}.parquet",
    output:
        predictions=f"{R}/emulators/{{emulator}}/{{set}}_predictions.parquet",
        errors=f"{R}/emulators/{{emulator}}/{{set}}_errors.csv",
    params:
        call="emulators:predict_test_set",
    wildcard_constraints:
        set=any_of(SCORED),
    log:
        f"{LOGS}/emulators/{{emulator}}/predict_{{set}}.log",
    threads: 1
    script:
        "../scripts/call.py"
