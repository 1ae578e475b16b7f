"""Snakemake's lint, but for what it says of software: one environment serves all rules (envs/)."""

import re
import subprocess
import sys

ACCEPTED = "Specify a conda environment or container for each rule.:"


def findings(config: str) -> tuple[list[str], str]:
    """What is found in the workflow with a configuration, without what is accepted, and the whole
    output. Raises CalledProcessError where the workflow cannot be read."""
    command = [sys.executable, "-m", "snakemake", "--lint", "--configfile", config]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    output = done.stdout + done.stderr
    found = re.findall(r"^    \* (.*)$", output, flags=re.MULTILINE)
    if done.returncode and not found:
        raise subprocess.CalledProcessError(done.returncode, command, output)
    return [text for text in found if text != ACCEPTED], output


if __name__ == "__main__":
    others, text = findings(sys.argv[1])
    if others:
        sys.exit(f"{text}\nThe workflow's lint found: {'; '.join(others)}")
    print("The workflow's lint found nothing.")
