"""Training, and the error on simulations held out."""


rule train_emulator:
    input:
        train=f"{R}/screening/train.parquet",
        library=library("emulators"),
    output:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        report=f"{R}/emulators/{{emulator}}/fit.json",
    params:
        name=lambda wildcards: EMULATORS[wildcards.emulator][0],
        settings=lambda wildcards: EMULATORS[wildcards.emulator][1],
        bounds=BOUNDS,
        seed=config["seed"],
    wildcard_constraints:
        emulator=any_of(EMULATORS),
    log:
        f"{LOGS}/emulators/{{emulator}}/train.log",
    benchmark:
        f"{R}/benchmarks/emulators/{{emulator}}.tsv"
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/train_emulator.py"


rule predict_test_set:
    input:
        emulator=f"{R}/emulators/{{emulator}}.pt",
        test=f"{R}/screening/test.parquet",
        library=library("emulators"),
    output:
        predictions=f"{R}/emulators/{{emulator}}/test_predictions.parquet",
        errors=f"{R}/emulators/{{emulator}}/test_errors.csv",
    log:
        f"{LOGS}/emulators/{{emulator}}/predict_test_set.log",
    threads: 1
    conda:
        "../../envs/statistics.yaml"
    script:
        "../scripts/predict_test_set.py"
