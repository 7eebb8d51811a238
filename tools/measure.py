"""What the scripts that measure the program share: running it, and results that are kept as they come."""
import json
import os
import subprocess


class Unmet(RuntimeError):
    """A goal that cannot be reached, exit status 1; says what the program said last."""


def run(weft, *arguments):
    """The JSON report of a run."""
    result = subprocess.run([weft, *arguments, "--json", "--quiet"], capture_output=True, text=True, check=False)
    said = result.stderr.strip()
    if result.returncode == 1:
        raise Unmet(said.splitlines()[-1] if said else "exit status 1")
    if result.returncode != 0:
        raise RuntimeError(f"weft {' '.join(arguments)}: {said}")
    return json.loads(result.stdout)


def materials(weft):
    """Names of the materials that `weft synth` makes."""
    listed = subprocess.run([weft, "synth", "--list"], capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        raise RuntimeError(f"weft synth --list: {listed.stderr.strip()}")
    return [line.split()[0] for line in listed.stdout.splitlines() if line.strip()]


def load(path):
    """Results of earlier runs, by key; none without a file."""
    if not path or not os.path.exists(path):
        return {}
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def save(path, results):
    """Written beside it first, so that a stopped run leaves whole results."""
    if not path:
        return
    with open(path + ".part", "w", encoding="utf-8") as file:
        json.dump(results, file, indent=1, sort_keys=True)
    os.replace(path + ".part", path)
